"""What holds of a sensor: `SensorState`, for people to see, `KeptState`, over a restart.

Control, dashboard, MQTT, metrics and the status file read the one; none of them can change it. The
other lies beside the event log. What cannot be read of it counts as nothing: the sensor is then in
its configured state, which is armed unless somebody chose otherwise.
"""

import json
import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from pydantic import BaseModel

from radard.alarm.panel import ArmMode, PanelState
from radard.judge.decision import GateState, Label
from radard.log import EventLog
from radard.stream.frame_timing import Drift
from x2radar import wall_clock

log = logging.getLogger("radard")


@dataclass(frozen=True, slots=True)
class CalibrationProgress:
    """How far the calibration of a room is."""

    phase: str  # leave, listen, made or failed
    left_s: int = 0
    text: str = ""

    @property
    def is_over(self) -> bool:
        """Whether it has ended, well or not."""
        return self.phase in {"made", "failed"}


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorState:
    """One moment between two decisions of a sensor that has a stream."""

    armed: bool = True  # whether hits can raise an alarm, now or once the exit delay is over
    mode: ArmMode = "away"
    panel: PanelState = "armed"
    delay_left_s: float | None = None  # of the exit or entry delay; None while none runs
    sensitivity: str = "normal"
    alarm_id: str | None = None  # of the alarm that is on
    open: Mapping[str, str] = field(default_factory=dict)  # reasons of events that are on, by kind
    t_s: float = 0.0  # of the last decision
    seq: int = 0  # and its number; 0: none yet
    gate: GateState | None = None
    label: Label | None = None
    clock_drift: Drift | None = None  # None until it is known
    calibration: CalibrationProgress | None = None  # the last one that was asked for

    def as_record(self, mark: str = "") -> dict[str, Any]:
        """Return it as status files and pages have it, marked as the stream's records are."""
        return {**asdict(self), **({mark: True} if mark else {})}


class KeptState(BaseModel, frozen=True):
    """What outlives a restart: how the sensor is armed, its alarm and its delays."""

    is_armed: bool  # the last word of a command
    mode: ArmMode = "away"  # and how it is armed
    alarm_id: str | None = None  # of an alarm that was on when the daemon ended
    alarm_reason: str = ""  # why it was on
    alarm_peak: float = 0.0  # highest p(human) in it
    alarm_clip: str | None = None  # the recording made of it
    entry_reason: str | None = None  # of an entry delay that was running
    exit_left_s: float | None = None  # of an exit delay that was running
    exit_ends_unix_s: float | None = None  # when that ends, by the clock on the wall


class StateStore:
    """Keep a `KeptState`, in a log if it has a name; without `keeps_alarms` only the last word."""

    def __init__(self, events: EventLog, name: str | None, *, keeps_alarms: bool = True) -> None:
        self._log = events
        self._name = None if name is None else f"panel {name}"
        self._keeps_alarms = keeps_alarms
        self.has_kept = False  # whether `load` has found anything
        self._saved: KeptState | None = None
        self._text: str | None = None

    def load(self, *, is_armed: bool) -> KeptState:
        """Return what was kept; without anything, a state without an alarm that is so armed."""
        if self._saved is None:
            self._text = None if self._name is None else self._log.kept(self._name)
            found = None
            try:
                if self._text is not None:
                    found = KeptState.model_validate(json.loads(self._text))
            except (ValueError, RecursionError) as err:
                why = " ".join(str(err).split())
                log.warning("%s: the kept state is unreadable and not used (%s)", self._name, why)
            self.has_kept = found is not None
            self._saved = self._whole(found or KeptState(is_armed=is_armed))
        kept, left_s = self._saved, None
        if kept.exit_left_s is not None and kept.exit_ends_unix_s is not None:
            left_s = max(0.0, min(kept.exit_left_s, kept.exit_ends_unix_s - wall_clock.now_s()))
        return kept.model_copy(update={"exit_left_s": left_s, "exit_ends_unix_s": None})

    def save(self, state: KeptState) -> None:
        """Keep a state; waits for no disk longer than `EventLog.keep`."""
        if state.exit_left_s is not None:
            ends_s = round(wall_clock.now_s() + state.exit_left_s, 3)
            state = state.model_copy(update={"exit_ends_unix_s": ends_s})
        if self._saved is None or self._whole(state) != self._whole(self._saved):
            self._text = json.dumps(self._whole(state).model_dump())
        # Behind its text: what is asked meanwhile is not kept yet.
        self._saved = state
        if self._name is not None and self._text is not None:
            self._log.keep(self._name, self._text)

    def why_lost(self, state: SensorState | None = None) -> str | None:
        """Return why a state would not outlive a kill, as `EventLog.why_lost`; for any thread."""
        if self._name is None or (saved := self._saved) is None:
            return ""
        if state is not None:
            now = state.armed, state.mode, state.alarm_id
            if (saved.is_armed, saved.mode, saved.alarm_id) != now:
                return None
        return "" if self._text is None else self._log.why_lost(self._name, self._text)

    def _whole(self, state: KeptState) -> KeptState:
        """Return what the log has of a state."""
        if self._keeps_alarms:
            return state
        return KeptState(is_armed=state.is_armed, mode=state.mode)
