"""Health: starting, online, degraded or offline, fed by decisions and notices only."""

from dataclasses import dataclass
from typing import Literal

from radard.decision import Decision
from radard.ring import Notice

State = Literal["starting", "online", "degraded", "offline"]


@dataclass(frozen=True, slots=True)
class Status:
    """A state and why."""

    state: State
    reason: str


class Health:
    """Online means: a decision was made from fresh frames. Returns a status on change."""

    def __init__(self) -> None:
        self.status = Status("starting", "waiting for the first dwell")

    def on_decision(self, decision: Decision) -> Status | None:
        """Take a decision."""
        if decision.gate == "invalid":
            return self._go("degraded", decision.fault)
        return self._go("online", "")

    def on_notice(self, notice: Notice) -> Status | None:
        """Take a notice."""
        if notice.kind == "lost":
            return self._go("offline", f"device absent: {notice.reason}")
        return self._go("degraded", notice.reason)

    def on_end(self, reason: str) -> Status | None:
        """Note that the stream is over."""
        return self._go("offline", reason)

    def _go(self, state: State, reason: str) -> Status | None:
        if state == self.status.state:
            return None
        self.status = Status(state, reason)
        return self.status
