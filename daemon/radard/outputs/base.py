"""The contract of a sink, and what a sink may ask of the run it belongs to.

A sink takes records, the plain mappings of the JSON Lines contract; it knows nothing of
radar. Whatever happens at its far end, `write` returns at once, and the run hears of trouble
through `state` alone.
"""

import errno
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol

from radard.alarm.sensor_state import SensorState
from radard.config.config import Config
from radard.health.health import Health
from radard.stream.playback import Playback
from radard.stream.ring import FrameRing

COMMANDS = ("arm", "arm-home", "disarm", "ack", "calibrate")
Record = Mapping[str, Any]
PASSING = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO})
"""Faults of a disk that may pass: a sink starts in spite of them, and tries again."""


class DeliveryError(Exception):
    """A record could not be handed on; it is tried again.

    Parameters
    ----------
    reason : str
        For people; must hold no secrets.
    is_refusal : bool
        The far end answered, and did not want this record. Such a record is tried only so
        often, because it keeps those behind it waiting.
    """

    def __init__(self, reason: str, *, is_refusal: bool = False) -> None:
        super().__init__(" ".join(reason.split()))
        self.is_refusal = is_refusal


class HealthState(Protocol):
    """State (starting, online, degraded, offline) and reason, as in records of type status."""

    @property
    def state(self) -> str:
        """The state's name."""

    @property
    def reason(self) -> str:
        """For people."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SinkContext:
    """What a run tells its sinks, and what it lets them do.

    Attributes
    ----------
    sensor : str
        Name of the sensor; of several that share a sink each record names its own.
    is_one_of_several : bool
        Whether other sensors of this process have a sink of this kind for themselves.
    state_dir : Path or None
        Where undelivered events are kept over a restart; None keeps them in memory only.
    can_wait : bool
        The stream can wait, as a replay or a simulation at full speed: `write` to a file or
        to stdout then waits for room instead of dropping, and their failure ends the run.
    mark : {'', 'simulated', 'replayed'}
        What the stream is, unless a module sends it now.
    command : callable or None
        Takes one of `COMMANDS`, from any thread; must not wait.
    choose : callable or None
        Takes the name of a sensitivity, from any thread, and keeps it over restarts; raises
        RadardError if that cannot be done.
    panel : callable or None
        Returns what `Host.panel` does, for any thread.
    health : callable or None
        Returns the daemon's state at this moment, for any thread.
    """

    sensor: str = "radar"
    is_one_of_several: bool = False
    state_dir: Path | None = None
    can_wait: bool = False
    mark: str = ""
    command: Callable[[str], None] | None = None
    choose: Callable[[str], None] | None = None
    panel: Callable[[], SensorState | None] | None = None
    health: Callable[[], HealthState] | None = None

    @property
    def marked_sensor(self) -> str:
        """The sensor's name where a simulated or replayed stream must not look real."""
        return f"{self.sensor}-{self.mark}" if self.mark else self.sensor


class Host(Protocol):
    """What a sensor offers to its sinks; any thread may use it, and nothing here waits."""

    sensor: str
    """Its name."""
    health: Health
    """Its status at any moment."""

    def config(self) -> Config:
        """Return the configuration that holds."""

    def panel(self) -> SensorState | None:
        """Return what holds now; None before there is a stream."""

    def command(self, name: str) -> None:
        """Take one of `COMMANDS`; raises ValueError at any other."""

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
        """Send a test alarm; return what every output made of it (`radard.outputs.trial`).

        Waits some seconds for that. Raises ValueError while a real alarm is on.
        """

    def mark(self) -> str:
        """Return 'simulated' or 'replayed'; an empty text while a module sends the frames."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SinkState:
    """How a sink is doing.

    Attributes
    ----------
    status : {'ok', 'retrying'}
        Retrying: the last attempt failed, or nothing is connected yet.
    reason : str
        Why it is retrying; empty when ok.
    n_sent, n_waiting : int
        Records handed on, and records that wait, with those of an earlier run.
    n_dropped : int
        Records that were given up: no room, refused too often, too old, or left at the end.
    n_failures : int
        Attempts that failed.
    busy_s : float
        How long the attempt at hand has lasted, in seconds; 0 where there is none.
    """

    status: Literal["ok", "retrying"] = "ok"
    reason: str = ""
    n_sent: int = 0
    n_waiting: int = 0
    n_dropped: int = 0
    n_failures: int = 0
    busy_s: float = 0.0

    @property
    def is_ok(self) -> bool:
        """Whether the last attempt succeeded."""
        return self.status == "ok"


class Sink(Protocol):
    """Takes records in order."""

    @property
    def name(self) -> str:
        """What -o/--output named, without secrets."""

    @property
    def state(self) -> SinkState:
        """How it is doing; for any thread."""

    @property
    def waits(self) -> bool:
        """Whether `write` waits for room, see `SinkContext.can_wait`."""

    def write(self, record: Record) -> None:
        """Take one record; returns at once unless the sink `waits`.

        Raises
        ------
        BrokenPipeError
            If nobody reads stdout any more.
        OutputError
            If stdout fails, or a file of a run that can wait. No other sink raises.
        """

    def finish(self, timeout_s: float | None = None) -> None:
        """Take no more records, begin to hand on the rest within `timeout_s`; returns at once."""

    def close(self, timeout_s: float | None = None) -> None:
        """Finish, hand on what is left if that is possible in time, and release everything.

        Parameters
        ----------
        timeout_s : float, optional
            Time for it. Without one, two seconds, and for a sink that `waits` all the time
            it needs. A second call does nothing.

        Raises
        ------
        BrokenPipeError, OutputError
            As `write`, unless that has already raised it.
        """


class StateKeeper:
    """Holds a sink's state; every change is one step that any thread may take or see."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._state = SinkState()

    def state(self, n_waiting: int) -> SinkState:
        """Return what holds now."""
        with self._lock:
            return replace(self._state, n_waiting=n_waiting)

    def begin(self, reason: str) -> None:
        """Begin with nothing connected yet."""
        with self._lock:
            self._state = replace(self._state, status="retrying", reason=reason)

    def sent(self, n: int = 1) -> bool:
        """Count success; return whether it ends a time of trouble."""
        with self._lock:
            was = self._state
            self._state = replace(was, status="ok", reason="", n_sent=was.n_sent + n)
            return not was.is_ok

    def failed(self, reason: str) -> bool:
        """Count a failed attempt; return whether this trouble is new."""
        with self._lock:
            was, n = self._state, self._state.n_failures + 1
            self._state = replace(was, status="retrying", reason=reason, n_failures=n)
            return reason != was.reason

    def dropped(self, n: int) -> bool:
        """Count dropped records; return whether they are the first."""
        with self._lock:
            was = self._state.n_dropped
            self._state = replace(self._state, n_dropped=was + n)
            return n > 0 and was == 0
