"""Health: one state machine, fed by decisions from fresh frames; every status output reads it.

systemd's watchdog, the status file, MQTT's availability, `/healthz` and `radard health` ask
this object. It is asked, it does not ask: without a decision for `stale_s` it says offline
by itself, whatever thread stands still. A device that is away is declared (`on_notice`);
then there is nothing to restart, and only then the watchdog is fed without decisions.
"""

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from radard.judge.decision import Decision
from radard.stream.ring import Notice

State = Literal["starting", "online", "degraded", "offline"]
STALE_S = 5.0  # chosen: five hops, half of the unit's WatchdogSec
START_S = 15.0  # chosen: a module's reset and the first dwell


@dataclass(frozen=True, slots=True)
class Status:
    """A state and why."""

    state: State
    reason: str

    @property
    def is_well(self) -> bool:
        """Whether people are looked after: online or degraded."""
        return self.state in {"online", "degraded"}


class Health:
    """Online means: a decision was made from fresh frames. Any thread may ask.

    Methods that take something return a status when the state has changed, else None. Without a
    decision for `stale_s` it is offline, by the host's monotonic clock.
    """

    def __init__(
        self, *, stale_s: float = STALE_S, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._stale_s = stale_s
        self._clock = clock
        self._lock = threading.Lock()
        self._base = Status("starting", "waiting for the first dwell")
        self._fresh_s = clock() + max(0.0, START_S - stale_s)
        self._complaints: dict[str, str] = {}
        self._is_absent = self._is_over = False
        self._told: State = "starting"

    @property
    def status(self) -> Status:
        """What holds now."""
        with self._lock:
            return self._now()

    @property
    def may_feed(self) -> bool:
        """Whether the watchdog may be fed: decisions are fresh, or the device is declared away."""
        with self._lock:
            return not self._is_over and (self._is_absent or self._now().is_well)

    @property
    def is_over(self) -> bool:
        """Whether the run of this sensor has ended for good."""
        with self._lock:
            return self._is_over

    @property
    def age_s(self) -> float:
        """Seconds since the newest frame that went into a decision, or since the start."""
        with self._lock:
            return max(0.0, self._clock() - self._fresh_s)

    def on_decision(self, decision: Decision) -> Status | None:
        """Take a decision; what counts is when its last frame arrived."""
        invalid = decision.gate == "invalid"
        base = Status("degraded", decision.fault) if invalid else Status("online", "")
        return self._go(base, decision.t_mono_s)

    def on_notice(self, notice: Notice) -> Status | None:
        """Take a notice."""
        if notice.kind == "lost":
            return self._go(Status("offline", f"device absent: {notice.reason}"), absent=True)
        return self._go(Status("degraded", notice.reason))

    def on_start(self) -> Status | None:
        """Note that the work begins again."""
        with self._lock:
            self._is_absent = False
            self._base = Status("starting", "waiting for the first dwell")
            self._fresh_s = self._clock() + max(0.0, START_S - self._stale_s)
            return self._changed()

    def on_failure(self, reason: str) -> Status | None:
        """Note that the work broke off and will begin again: declared, as an absent device."""
        return self._go(Status("offline", reason), absent=True)

    def on_end(self, reason: str) -> Status | None:
        """Note that the run is over."""
        with self._lock:
            self._is_over, self._is_absent = True, False
            self._base = Status("offline", reason)
            return self._changed()

    def complain(self, source: str, reason: str) -> Status | None:
        """Note what is wrong beside the stream, an output say; an empty reason takes it back."""
        with self._lock:
            self._complaints.pop(source, None)
            if reason:
                self._complaints[source] = f"{source}: {reason}"
            return self._changed()

    def check(self) -> Status | None:
        """Look at the clock."""
        with self._lock:
            return self._changed()

    def _go(self, base: Status, fresh_s: float = 0.0, *, absent: bool = False) -> Status | None:
        with self._lock:
            if self._is_over:
                return None
            self._base, self._is_absent = base, absent
            self._fresh_s = fresh_s or self._clock()
            return self._changed()

    def _now(self) -> Status:
        if self._is_over or self._is_absent:
            return self._base
        age_s = self._clock() - self._fresh_s
        if age_s > self._stale_s:
            return Status("offline", f"no decision from fresh frames for {age_s:.0f} s")
        if not self._complaints or self._base.state == "starting":
            return self._base
        reasons = [self._base.reason] if self._base.reason else []
        return Status("degraded", "; ".join([*reasons, *self._complaints.values()]))

    def _changed(self) -> Status | None:
        now = self._now()
        if now.state == self._told:
            return None
        self._told = now.state
        return now


def overall(healths: Mapping[str, Health]) -> Status:
    """Return one state for all sensors of a process, by name.

    Degraded names those that are not online; offline means that nobody is looked after.
    """
    states = {name: health.status for name, health in healths.items()}
    if len(states) == 1:
        return next(iter(states.values()))
    reason = "; ".join(
        f"{name}: {status.state}" + (f": {status.reason}" if status.reason else "")
        for name, status in states.items()
        if status.state != "online"
    )
    if not reason:
        return Status("online", "")
    if any(status.is_well for status in states.values()):
        return Status("degraded", reason)
    is_starting = any(status.state == "starting" for status in states.values())
    return Status("starting" if is_starting else "offline", reason)


def may_feed_all(healths: Iterable[Health]) -> bool:
    """Whether the watchdog may be fed for every sensor whose run goes on, if there is one."""
    going = [health for health in healths if not health.is_over]
    return bool(going) and all(health.may_feed for health in going)
