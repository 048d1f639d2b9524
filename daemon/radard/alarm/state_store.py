"""StateStore: what must outlive the daemon, in one small JSON file that is never half written.

A file that cannot be read counts as none: the sensor is then in its configured state, which is
armed unless somebody chose otherwise.
"""

import json
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from radard.alarm.panel import ArmMode
from radard.config.atomic import write_atomically

log = logging.getLogger("radard")
_WAIT_S = 0.5  # chosen: a person does not notice it; disks take a tenth of it


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptState:
    """What is kept."""

    is_armed: bool  # the last word of a command
    mode: ArmMode = "away"  # and how it is armed
    alarm_id: str | None = None  # of an alarm that was on when the daemon ended
    alarm_reason: str = ""  # why it was on
    alarm_peak: float = 0.0  # highest p(human) in it
    alarm_clip: str | None = None  # the recording made of it
    entry_reason: str | None = None  # of an entry delay that was running
    exit_left_s: float | None = None  # of an exit delay that was running


class StateStore:
    """Keep one `KeptState` in a file; without a path, nothing.

    Without `keeps_alarms` only the last command's word is kept, not an alarm or a delay. An exit
    delay goes on while nothing runs, by `now_s`, the wall clock in seconds: it is kept as the time
    at which it ends. A clock that was set back makes it no longer than it was.
    """

    def __init__(
        self,
        path: Path | None,
        *,
        keeps_alarms: bool = True,
        now_s: Callable[[], float] = time.time,
    ) -> None:
        self._path = path
        self._now_s = now_s
        self._keeps_alarms = keeps_alarms
        self._asked: KeptState | None = None
        self._held: KeptState | None = None
        self._has_failed = False
        self._waiting: tuple[KeptState, str] | None = None
        self._writer: threading.Thread | None = None
        self._changed = threading.Condition()

    def load(self, *, is_armed: bool) -> KeptState:
        """Return what was kept; without anything, a state without an alarm that is so armed."""
        kept = self._load()
        if kept is None or not self._keeps_alarms:
            kept = _word_of(kept or KeptState(is_armed=is_armed))
        self._asked = self._held = kept
        return kept

    def holds(self, *, is_armed: bool, mode: ArmMode) -> bool:
        """Return whether this would outlive a kill; true also where a disk fails or is absent.

        Any thread may ask.
        """
        held = self._held
        is_so = held is not None and (held.is_armed, held.mode) == (is_armed, mode)
        return is_so or self._path is None or self._has_failed

    def _load(self) -> KeptState | None:
        if self._path is None:
            return None
        try:
            raw = json.loads(self._path.read_text(encoding="utf-8"))
            kept = KeptState(
                is_armed=bool(raw["is_armed"]),
                alarm_id=_text(raw.get("alarm_id")),
                alarm_reason=str(raw.get("alarm_reason", "")),
                alarm_peak=float(raw.get("alarm_peak", 0.0)),
                alarm_clip=_text(raw.get("alarm_clip")),
                entry_reason=_text(raw.get("entry_reason")),
                mode="home" if raw.get("mode") == "home" else "away",
                exit_left_s=self._exit_left_s(raw),
            )
        except FileNotFoundError:
            return None
        except (
            OSError,
            ValueError,
            LookupError,
            TypeError,
            ArithmeticError,
            RecursionError,
        ) as err:
            log.warning("%s: the kept state is unreadable and not used (%r)", self._path, err)
            return None
        return kept

    def save(self, state: KeptState) -> None:
        """Keep a state; a failure is logged, for an alarm must not fail with its disk.

        Nor wait for it: after half a second a slow disk goes on by itself, and with the newest
        state alone. One thread is to call this.
        """
        if not self._keeps_alarms:
            state = _word_of(state)
        if self._path is None or (state == self._asked and not self._has_failed):
            return
        raw = asdict(state)
        if state.exit_left_s is not None:
            raw["exit_ends_unix_s"] = round(self._now_s() + state.exit_left_s, 3)
        with self._changed:
            self._asked, self._waiting = state, (state, json.dumps(raw) + "\n")
            if self._writer is None:
                self._writer = threading.Thread(
                    target=self._write, args=(self._path,), name="state", daemon=True
                )
                self._writer.start()
            if not self._changed.wait_for(lambda: self._writer is None, _WAIT_S):
                log.warning("%s: the state is not kept yet: the disk is slow", self._path)

    def _write(self, path: Path) -> None:
        """Write what waits until nothing does."""
        while True:
            with self._changed:
                waiting, self._waiting = self._waiting, None
                if waiting is None:
                    self._writer = None
                    self._changed.notify_all()
                    return
            try:
                write_atomically(path, waiting[1], mode=0o600)
            except OSError as err:
                log.warning("%s: cannot keep the state: %s", path, err.strerror or err)
                self._has_failed = True
            else:
                self._held, self._has_failed = waiting[0], False

    def _exit_left_s(self, raw: dict[str, Any]) -> float | None:
        left_s, ends_s = raw.get("exit_left_s"), raw.get("exit_ends_unix_s")
        if left_s is None or ends_s is None:
            return None
        return max(0.0, min(float(left_s), float(ends_s) - self._now_s()))


def _word_of(state: KeptState) -> KeptState:
    return KeptState(is_armed=state.is_armed, mode=state.mode)


def _text(value: Any) -> str | None:
    return None if value is None else str(value)
