"""AlarmPanel: verdicts over time become an alarm, as a control panel would have it.

The states::

    disarmed --arm--> exit --exit_delay_s--> armed --K of N hits--> entry --entry_delay_s--> alarm
        ^              |                      ^ |                     |                       |
        +---disarm-----+--------disarm--------|-+-------disarm--------+--------disarm---------+
                                              +-----ack, or latch_s without anybody-----------+

Armed is `away`, or `home` where ranges may be left out (`radard.alarm.zones`); to change between
the two is to arm again. All times are stream time. What cannot be judged is never taken for
quiet: an invalid window neither ends an alarm nor stops a delay. A device that is lost during the
entry delay raises the alarm at once, and during the exit delay ends that delay.
"""

from collections import deque
from dataclasses import dataclass
from typing import Literal

PanelState = Literal["disarmed", "exit", "armed", "entry", "alarm"]
ArmMode = Literal["away", "home"]
ARM_MODES: dict[str, ArmMode] = {"arm": "away", "arm-home": "home"}  # commands that arm
# One window in which somebody is missed does not say that they left.
_UNSEEN_S = 3.0
# Stream times are quotients: what is due at this decision must not wait for the next.
_SLACK_S = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmPolicy:
    """When hits are an alarm, and for how long."""

    k: int = 1  # so many hits
    n: int = 1  # among so many decisions confirm
    p_on: float = 0.0  # least p(human) that makes a verdict a hit
    p_off: float = 1.0  # an alarm sees somebody above it, verdict or not; 1: by the verdict alone
    exit_delay_s: float = 0.0  # from the command to being armed
    entry_delay_s: float = 0.0  # from confirmation to alarm
    latch_s: float = 0.0  # an alarm ends when nobody was seen for so long
    refractory_s: float = 0.0  # after an alarm none begins for so long


@dataclass(frozen=True, slots=True)
class Sight:
    """What one valid decision says of people."""

    is_hit: bool  # somebody who counts towards an alarm
    is_seen: bool  # somebody still there, for an alarm that is on; every hit is
    reason: str = ""  # who and where, for people


@dataclass(frozen=True, slots=True)
class PanelChange:
    """What becomes of the alarm: it begins, changes or ends, and why."""

    kind: Literal["new", "update", "end"]
    reason: str


class AlarmPanel:
    """Follow sights and commands; `policy` may be replaced, and what is on stays on."""

    def __init__(
        self, policy: AlarmPolicy | None = None, *, is_armed: bool = True, mode: ArmMode = "away"
    ) -> None:
        self.policy = policy or AlarmPolicy()
        self.state: PanelState = "armed" if is_armed else "disarmed"
        self.mode: ArmMode = mode
        self._hits: deque[bool] = deque(maxlen=16)
        self._since_s = 0.0
        self._seen_s = 0.0
        self._is_seen = False
        self._ready_s = float("-inf")
        self._reason = ""

    @property
    def is_armed(self) -> bool:
        """Whether hits can raise an alarm, now or once the exit delay is over."""
        return self.state != "disarmed"

    @property
    def is_seen(self) -> bool:
        """Whether an alarm is on and somebody is in sight."""
        return self.state == "alarm" and self._is_seen

    @property
    def entry_reason(self) -> str | None:
        """Why an alarm will begin once the entry delay is over; None while none is running."""
        return self._reason if self.state == "entry" else None

    def left_s(self, t_s: float) -> float | None:
        """Return what is left of the exit or entry delay at a stream time; None if none runs."""
        delays_s = {"exit": self.policy.exit_delay_s, "entry": self.policy.entry_delay_s}
        delay_s = delays_s.get(self.state)
        return None if delay_s is None else max(0.0, self._since_s + delay_s - t_s)

    def resume(self, reason: str) -> None:
        """Go on with an alarm that was on, or about to begin, before a restart."""
        self.state, self._reason = "alarm", reason

    def resume_exit(self, left_s: float) -> None:
        """Go on at stream time 0 with so much of an exit delay, at most all of it."""
        self.state, self._since_s = "exit", min(0.0, left_s - self.policy.exit_delay_s)

    def on_sight(
        self, t_s: float, sight: Sight | None, *, is_quiet: bool = False
    ) -> list[PanelChange]:
        """Take what a decision says, None for an invalid window; return the changes in order."""
        if self.state == "disarmed":
            return []
        if self.state == "alarm":
            return self._while_on(t_s, sight)
        if self.state == "exit":
            # The window that ends with the delay shows who has just left: the next one counts.
            if t_s - self._since_s >= self.policy.exit_delay_s - _SLACK_S:
                self.state = "armed"
            return []
        if sight is not None:
            self._hits.append(sight.is_hit and not is_quiet)
            if self._hits[-1]:
                self._reason = sight.reason
        is_confirmed = sum(list(self._hits)[-self.policy.n :]) >= self.policy.k
        if self.state == "armed" and is_confirmed and t_s >= self._ready_s - _SLACK_S:
            self.state, self._since_s = "entry", t_s
        if self.state == "entry" and t_s - self._since_s >= self.policy.entry_delay_s - _SLACK_S:
            return self._begin(t_s, self._reason, is_seen=sight is None or sight.is_seen)
        return []

    def on_loss(self, t_s: float) -> list[PanelChange]:
        """Note that the device is lost: stream time stands still from here on."""
        if self.state == "exit":
            self.state = "armed"
        if self.state != "entry":
            return []
        reason = f"{self._reason}; the sensor was lost during the entry delay"
        return self._begin(t_s, reason, is_seen=True)

    def arm(self, t_s: float = 0.0, mode: ArmMode = "away") -> list[PanelChange]:
        """Arm after the exit delay; with a delay or an alarm on, nothing changes."""
        if self.state in {"entry", "alarm"} or (self.is_armed and self.mode == mode):
            return []
        if self.state != "exit":
            self.state, self._since_s = "exit", t_s
        if self.policy.exit_delay_s <= 0:
            self.state = "armed"
        self.mode, self._ready_s = mode, float("-inf")
        self._hits.clear()
        return []

    def disarm(self) -> list[PanelChange]:
        """Disarm from any state; an alarm that is on ends."""
        was, self.state = self.state, "disarmed"
        return [PanelChange("end", "disarmed")] if was == "alarm" else []

    def acknowledge(self, t_s: float) -> list[PanelChange]:
        """End an alarm; the sensor stays armed."""
        return self._end(t_s, "acknowledged") if self.state == "alarm" else []

    def _begin(self, t_s: float, reason: str, *, is_seen: bool) -> list[PanelChange]:
        self.state, self._seen_s, self._is_seen = "alarm", t_s, is_seen
        return [PanelChange("new", reason)]

    def _while_on(self, t_s: float, sight: Sight | None) -> list[PanelChange]:
        was_seen = self._is_seen
        if sight is None or sight.is_seen:
            self._seen_s = t_s
        if sight is None:
            return []
        unseen_s = t_s - self._seen_s + _SLACK_S
        if not sight.is_seen and unseen_s >= self.policy.latch_s:
            return self._end(t_s, f"nobody seen for {unseen_s:.0f} s")
        if sight.is_seen or unseen_s >= _UNSEEN_S:
            self._is_seen = sight.is_seen
        text = f"{sight.reason}, again" if sight.is_seen else "nobody in sight"
        return [] if self._is_seen == was_seen else [PanelChange("update", text)]

    def _end(self, t_s: float, reason: str) -> list[PanelChange]:
        self.state = "armed"
        self._hits.clear()
        self._ready_s = t_s + self.policy.refractory_s
        return [PanelChange("end", reason)]
