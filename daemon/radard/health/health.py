"""Health: one state machine, fed by decisions from fresh frames; every status output reads it.

systemd's watchdog, the status file, MQTT's availability, `/healthz` and `radard health` ask
this object. It is asked, it does not ask: without a decision for `stale_s` it says offline
by itself, whatever thread stands still. Only decisions are a sign of life: a module that
restarts again and again says much and decides nothing. A device that is away is declared
(`on_notice`); then there is nothing to restart, and only then the watchdog is fed without
decisions. Once it is back a decision is due within `stale_s`, and only a decision earns another
such wait.
"""

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from radard.judge.decision import Decision
from radard.stream.ring import Notice

State = Literal["starting", "online", "degraded", "offline"]
STALE_S = 5.0  # five hops, half of the unit's WatchdogSec
START_S = 15.0  # a module's reset, its first dwell, and room for a slow computer


@dataclass(frozen=True, slots=True)
class Status:
    """The daemon's state, and the reason for it in words."""

    state: State
    reason: str

    def __str__(self) -> str:
        return f"{self.state}: {self.reason}" if self.reason else self.state

    @property
    def is_well(self) -> bool:
        """Whether people are looked after: online or degraded."""
        return self.state in {"online", "degraded"}


_STARTING = Status("starting", "waiting for the first dwell")


class Health:
    """Online means: a decision was made from fresh frames. Any thread may ask.

    Methods that are told something return a status when the state has changed, else None. Times
    are those of the host's monotonic clock.
    """

    def __init__(
        self, *, stale_s: float = STALE_S, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._stale_s = stale_s
        self._clock = clock
        self._lock = threading.Lock()
        self._base = _STARTING
        self._decided_s = clock()
        self._due_s = self._decided_s + max(START_S, stale_s)
        self._may_wait = True
        self._complaints: dict[str, str] = {}
        self.is_over = False  # whether the run of this sensor has ended for good; for any thread
        self._told: State = "starting"

    @property
    def status(self) -> Status:
        """The status at this moment."""
        with self._lock:
            return self._now()

    @property
    def may_feed(self) -> bool:
        """Whether the watchdog may be fed: decisions are fresh, or the device is declared away."""
        with self._lock:
            is_away = self._base.state == "offline"
            return not self.is_over and (is_away or self._now().is_well)

    @property
    def age_s(self) -> float:
        """Seconds since the newest frame that went into a decision, or since the start."""
        return max(0.0, self._clock() - self._decided_s)

    def on_decision(self, decision: Decision) -> Status | None:
        """Note a decision; what counts is when its last frame arrived."""
        with self._lock:
            if self.is_over:
                return None
            self._decided_s = decision.t_mono_s or self._clock()
            self._due_s = self._decided_s + self._stale_s
            self._may_wait = True
            if decision.gate == "invalid":
                return self._say(Status("degraded", decision.fault))
            return self._say(Status("online", ""))

    def on_notice(self, notice: Notice) -> Status | None:
        """Note what happened to the stream."""
        with self._lock:
            if notice.kind == "lost":
                return self._say(Status("offline", f"device absent: {notice.reason}"))
            if notice.kind == "found" and self._base.state == "offline":
                self._wait(self._stale_s)
            elif notice.kind == "paused":
                # A replay that is held on purpose says so all the while, and guards nobody.
                self._due_s = self._clock() + self._stale_s
            elif not self._base.is_well:
                # A module that restarts in a loop before any decision looks after nobody.
                return self._changed()
            return self._say(Status("degraded", notice.reason))

    def on_start(self) -> Status | None:
        """Note that the work begins again."""
        with self._lock:
            self._wait(max(START_S, self._stale_s))
            return self._say(_STARTING)

    def on_failure(self, reason: str) -> Status | None:
        """Note that the work broke off and will begin again: declared, as an absent device."""
        with self._lock:
            return self._say(Status("offline", reason))

    def on_end(self, reason: str) -> Status | None:
        """Note that the run is over."""
        with self._lock:
            now, self.is_over = self._say(Status("offline", reason)), True
            return now

    def complain(self, source: str, reason: str) -> Status | None:
        """Note what is wrong beside the stream, an output say; an empty reason takes it back."""
        with self._lock:
            self._complaints.pop(source, None)
            if reason:
                self._complaints[source] = f"{source}: {reason}"
            return self._changed()

    def check(self) -> Status | None:
        """Return the status if time alone has changed it, as when decisions stopped; else None."""
        with self._lock:
            return self._changed()

    def _wait(self, seconds: float) -> None:
        """Let the next decision be due so much later; once, until there is one."""
        if self._may_wait:
            self._due_s, self._may_wait = self._clock() + seconds, False

    def _say(self, base: Status) -> Status | None:
        if self.is_over:
            return None
        self._base = base
        return self._changed()

    def _now(self) -> Status:
        if self._base.state == "offline":
            return self._base
        now_s = self._clock()
        if now_s > self._due_s:
            age_s = now_s - self._decided_s
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
    """Return one state for all sensors of a process, by name."""
    states = {name: health.status for name, health in healths.items()}
    if len(states) == 1:
        return next(iter(states.values()))
    reason = "; ".join(f"{n}: {now}" for n, now in states.items() if now.state != "online")
    if not reason or any(status.is_well for status in states.values()):
        return Status("degraded" if reason else "online", reason)
    is_starting = any(status.state == "starting" for status in states.values())
    return Status("starting" if is_starting else "offline", reason)


def may_feed_all(healths: Iterable[Health]) -> bool:
    """Whether the watchdog may be fed for every sensor whose run goes on, if there is one."""
    going = [health.may_feed for health in healths if not health.is_over]
    return bool(going) and all(going)
