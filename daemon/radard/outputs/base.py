"""The contract of a sink, and what a sink may ask of the run it belongs to.

A sink takes records, the plain mappings of the JSON Lines contract; it knows nothing of
radar. Whatever happens at its far end, `write` returns at once, and the run hears of trouble
through `state` alone.
"""

import hashlib
import logging
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol

from radard.alarm.sensor_state import SensorState
from radard.config.config import Config
from radard.health.health import Health
from radard.log import Cursor, EventLog, Wants
from radard.stream.playback import Playback
from radard.stream.ring import FrameRing

log = logging.getLogger("radard")
COMMANDS = ("arm", "arm-home", "disarm", "ack", "calibrate")
Record = Mapping[str, Any]
_SAID_AGAIN_S = 60.0  # a line a minute does not fill a log
_REMARKED_S = 3600.0  # long enough for a person to see it


class DeliveryError(Exception):
    """A record could not be handed on; it is tried again.

    `reason` is for people and must hold no secrets. `is_refusal`: the far end answered, and did
    not want this record, which is then tried only so often: it keeps others waiting.
    """

    def __init__(self, reason: str, *, is_refusal: bool = False) -> None:
        super().__init__(" ".join(reason.split()))
        self.is_refusal = is_refusal


class Host(Protocol):
    """What a sensor offers to its sinks; any thread may use it, and nothing here waits."""

    sensor: str  # its name
    health: Health  # its status at any moment

    def config(self) -> Config:
        """Return the configuration that holds."""

    def panel(self) -> SensorState | None:
        """Return what holds now; None before there is a stream."""

    def command(self, name: str) -> None:
        """Take one of `COMMANDS`; raises ValueError at any other, and where one cannot be."""

    def ring(self) -> FrameRing | None:
        """Return the ring of the stream; None before there is one."""

    def playback(self) -> Playback | None:
        """Return the controls of a replay; None for anything else."""

    def driver(self) -> Mapping[str, int]:
        """Return what the driver has counted, by the names of `x2radar.RadarStats`."""

    def sinks(self) -> Sequence["Sink"]:
        """Return all sinks of the process."""

    def reload(self) -> None:
        """Ask for the configuration to be read again, as SIGHUP does."""

    def test_alarm(self) -> Sequence[Mapping[str, str]]:
        """Send a test alarm; return every output's answer. ValueError while a real one is on."""

    def mark(self) -> str:
        """Return 'simulated' or 'replayed'; an empty text while a module sends the frames."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SinkContext:
    """What a sink knows of the process it belongs to."""

    sensor: str = "radar"  # of several that share a sink each record names its own
    host: Host | None = None  # the radar whose records come here; None where several share a sink
    is_one_of_several: bool = False  # only this sensor's records come here; others have own sinks
    # As a replay or a simulation at full speed: `write` to a file or to stdout then waits for room
    # instead of dropping, and their failure ends the run.
    can_wait: bool = False
    mark: str = ""  # 'simulated' or 'replayed', unless a module sends the stream now
    log: EventLog = field(default_factory=lambda: EventLog(None))  # has events before any sink
    after: int | None = None  # number in the log after which a new output begins; None: its end

    @property
    def marked_sensor(self) -> str:
        """The sensor's name where a simulated or replayed stream must not look real."""
        return f"{self.sensor}-{self.mark}" if self.mark else self.sensor

    def cursor(self, output: str, target: str, wants: Wants) -> Cursor:
        """Return the cursor of a named output, which goes on where it was in an earlier run.

        Its own name holds a digest of the target, so that another target never gets what was
        meant for this one, and no secret is readable in it.
        """
        digest = hashlib.blake2b(target.encode(errors="surrogateescape"), digest_size=8)

        def is_for_it(record: Record) -> bool:
            is_own = not self.is_one_of_several or record.get("sensor") == self.sensor
            return is_own and wants(record)

        name = f"{self.marked_sensor} {output.partition(':')[0]} {digest.hexdigest()}"
        return self.log.cursor(name, is_for_it, self.after)


@dataclass(frozen=True, slots=True, kw_only=True)
class SinkState:
    """How a sink is doing."""

    status: Literal["ok", "retrying"] = "ok"  # retrying: also when nothing is connected yet
    reason: str = ""  # why it is retrying
    n_sent: int = 0  # records handed on
    n_events: int | None = None  # of them; a plug-in may not count them apart
    n_waiting: int = 0  # with those of an earlier run
    n_dropped: int = 0  # given up: no room, refused too often, too old, or left at the end
    n_failures: int = 0  # attempts
    busy_s: float = 0.0  # how long the attempt at hand has lasted
    remark: str = ""  # what was lost within the last hour, though all is well again

    @property
    def is_ok(self) -> bool:
        """Whether the last attempt succeeded."""
        return self.status == "ok"

    @property
    def n_told(self) -> int:
        """Events that were handed on, as far as that is known."""
        return self.n_sent if self.n_events is None else self.n_events


class Sink(Protocol):
    """An output: it is given records in order, and reports how it does."""

    name: str  # what -o/--output named, without secrets
    waits: bool  # whether `write` waits for room, see `SinkContext.can_wait`

    @property
    def state(self) -> SinkState:
        """How it is doing; for any thread."""

    def write(self, record: Record) -> None:
        """Take one record; returns at once unless the sink `waits`.

        Raises BrokenPipeError if nobody reads stdout any more, OutputError if stdout fails, or a
        file of a run that can wait. No other sink raises.
        """

    def finish(self, timeout_s: float | None = None) -> None:
        """Take no more records, begin to hand on the rest within `timeout_s`; returns at once."""

    def close(self, timeout_s: float | None = None) -> None:
        """Finish, hand on what is left if that is possible in time, and release everything.

        Without `timeout_s` it takes two seconds, and for a sink that `waits` all the time it
        needs. A second call does nothing. Raises as `write`, unless that has already raised it.
        """


class StateKeeper:
    """Holds a sink's state, and logs what becomes of it; any thread may take or see a step."""

    def __init__(self, name: str, why: str = "") -> None:
        self._name, self._lock = name, threading.Lock()
        # Until the first attempt it is not well if there is a `why`.
        self._state = SinkState(status="retrying" if why else "ok", reason=why, n_events=0)
        self._told, self._told_s, self._is_told = "", float("-inf"), True
        self._remark, self._remarked_s = "", float("-inf")

    def state(self, n_waiting: int) -> SinkState:
        """Return the sink's state, with what waits and a recent remark."""
        with self._lock:
            is_fresh = time.monotonic() - self._remarked_s < _REMARKED_S
            remark = self._remark if is_fresh else ""
            return replace(self._state, n_waiting=n_waiting, remark=remark)

    def remark(self, text: str) -> None:
        """Log what was lost, and show it in the state for a while."""
        log.warning("%s: %s", self._name, text)
        with self._lock:
            self._remark, self._remarked_s = text, time.monotonic()

    def sent(self, n: int = 1, *, is_event: bool = False) -> None:
        """Count `n` records that were handed on; a failure is over."""
        with self._lock:
            was = self._state
            n_events = (was.n_events or 0) + n * is_event
            self._state = replace(
                was, status="ok", reason="", n_sent=was.n_sent + n, n_events=n_events
            )
            if not was.is_ok and self._is_told:
                log.info("%s: works again", self._name)

    def failed(self, reason: str) -> None:
        """Count a failed attempt; trouble that comes and goes is logged once a minute."""
        with self._lock:
            was, n = self._state, self._state.n_failures + 1
            self._state = replace(was, status="retrying", reason=reason, n_failures=n)
            if reason == was.reason:
                return
            now_s = time.monotonic()
            self._is_told = reason != self._told or now_s - self._told_s >= _SAID_AGAIN_S
            if self._is_told:
                self._told, self._told_s = reason, now_s
                log.warning("%s: %s", self._name, reason)

    def dropped(self, n: int, why: str) -> None:
        """Count records that are given up; the first of them is logged."""
        with self._lock:
            was = self._state.n_dropped
            self._state = replace(self._state, n_dropped=was + n)
            if n > 0 and was == 0:
                log.warning("%s: drops records (%s); `state` counts them", self._name, why)
