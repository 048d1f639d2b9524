"""Decisions to events: alarm, fault and tamper have a beginning, an end, and an id.

The id is a ULID whose time part is stream time and whose random part is a digest of the run's
id and of the frame that the event began with. So a replay, which has the id of the run that was
recorded, gives the same ids, and two runs never do.
"""

import hashlib
import uuid
from dataclasses import dataclass, replace

from radard.alarm.panel import ARM_MODES, AlarmPanel, PanelChange
from radard.alarm.sensor_state import KeptState
from radard.alarm.zones import armed_zones, sight_of
from radard.config.sections import ZonesSection
from radard.config.sink_table import EventKind, Phase
from radard.judge.decision import Decision
from radard.stream.ring import Dwell, Notice

_CROCKFORD = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
_KEPT = " (on since before a restart)"


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """One phase of an alarm, a fault or a tamper."""

    id: str  # ULID; the same in every phase of one event
    phase: Phase = "new"  # whether it begins, changes or ends
    kind: EventKind = "alarm"
    t_s: float  # stream time of this phase
    start_t_s: float  # and of the beginning
    end_t_s: float | None = None
    peak: float = 0.0  # highest p(human) so far; 0 for fault and tamper
    reason: str  # for people
    clip: str | None = None  # the recording made of it
    is_trial: bool = False  # asked for, to see whether outputs hand it on


def trial_alarm(t_s: float) -> list[Event]:
    """Return both phases of an alarm that is only a test, at a stream time."""
    new = Event(
        id=_ulid(f"test {uuid.uuid4()}", t_s, None),
        t_s=t_s,
        start_t_s=t_s,
        reason="test alarm: nobody was seen",
        is_trial=True,
    )
    return [new, replace(new, phase="end", end_t_s=t_s)]


class EventTracker:
    """Follow decisions, notices and commands of a run; return the events that they make."""

    def __init__(
        self,
        panel: AlarmPanel | None = None,
        zones: ZonesSection | None = None,
        pet_limit: float = 0.8,
        run: str = "",
    ) -> None:
        self.panel = panel or AlarmPanel()
        self._run = run
        self.zones, self.pet_limit = zones or ZonesSection(), pet_limit
        self._open: dict[EventKind, Event] = {}
        self._entry_peak = 0.0

    @property
    def open_events(self) -> dict[EventKind, Event]:
        """What is on now, by kind."""
        return dict(self._open)

    def kept(self, t_s: float) -> KeptState:
        """Return what must outlive the daemon, at a stream time."""
        panel, alarm = self.panel, self._open.get("alarm")
        if alarm is not None:
            keys = ("id", "reason", "peak", "clip")
            about = {f"alarm_{key}": getattr(alarm, key) for key in keys}
            return KeptState(is_armed=True, mode=panel.mode, **about)
        return KeptState(
            is_armed=panel.is_armed,
            mode=panel.mode,
            entry_reason=panel.entry_reason,
            alarm_peak=self._entry_peak if panel.entry_reason is not None else 0.0,
            exit_left_s=panel.left_s(t_s) if panel.state == "exit" else None,
        )

    def resume(self, kept: KeptState) -> list[Event]:
        """Go on where the last run ended; an entry delay's alarm begins at once."""
        if not kept.is_armed:
            return []
        self.panel.mode = kept.mode
        if kept.exit_left_s:
            self.panel.resume_exit(kept.exit_left_s)
        if kept.alarm_id is not None:
            reason = f"{kept.alarm_reason.removesuffix(_KEPT)}{_KEPT}"
        elif kept.entry_reason is not None:
            reason = f"{kept.entry_reason}; radard was restarted during the entry delay"
        else:
            return []
        self.panel.resume(reason)
        event = self._begin("alarm", reason, 0.0, kept.alarm_peak, None)
        if kept.alarm_id is not None:
            event = replace(event, id=kept.alarm_id, phase="update", clip=kept.alarm_clip)
            self._open["alarm"] = event
        return [event]

    def on_decision(
        self, decision: Decision, dwell: Dwell, *, is_quiet: bool = False, fault: str = ""
    ) -> list[Event]:
        """Take a decision on a dwell, `fault` what else is wrong; return the events in order."""
        is_invalid = decision.gate == "invalid"
        t_s = decision.t_s
        why = decision.fault or ("" if is_invalid else fault) or None
        events, sight = self._follow("fault", why, t_s=t_s, dwell=dwell), None
        if not is_invalid:
            tamper = "; ".join(f"{f.kind}: {f.reason}" for f in decision.findings) or None
            events += self._follow("tamper", tamper, t_s=t_s, dwell=dwell)
            zones = armed_zones(self.zones, self.panel.mode)
            sight = sight_of(decision, self.panel.policy, zones, self.pet_limit)
        p_human = decision.fused.human if decision.fused and sight and sight.is_seen else 0.0
        was = self.panel.state
        steps = self.panel.on_sight(t_s, sight, is_quiet=is_quiet)
        # A body seen while the entry delay ran belongs to the alarm that ends it.
        self._entry_peak = peak = max(self._entry_peak if was == "entry" else 0.0, p_human)
        alarm = self._open.get("alarm")
        if alarm is not None:
            self._open["alarm"] = replace(alarm, peak=max(alarm.peak, p_human))
        return events + self._step(steps, t_s, peak, dwell)

    def on_notice(self, notice: Notice) -> list[Event]:
        """Take a notice: a restart or a lost device is a fault until the next whole dwell."""
        if notice.kind == "found":
            return []
        events = self._follow("fault", notice.reason, t_s=notice.t_s)
        steps = self.panel.on_loss(notice.t_s) if notice.kind == "lost" else []
        return events + self._step(steps, notice.t_s, self._entry_peak)

    def on_command(self, name: str, t_s: float) -> list[Event]:
        """Take 'arm', 'arm-home', 'disarm' or 'ack'."""
        if name in ARM_MODES:
            return self._step(self.panel.arm(t_s, ARM_MODES[name]), t_s)
        is_end = name == "disarm"
        return self._step(self.panel.disarm() if is_end else self.panel.acknowledge(t_s), t_s)

    def remark(self, kind: EventKind, text: str, t_s: float) -> list[Event]:
        """Update an event that is on with a remark; the next decision tells its reason again."""
        on = self._open.get(kind)
        return [] if on is None else [self._go_on(kind, f"{on.reason}; {text}", t_s, "update")]

    def end_all(self, reason: str, t_s: float) -> list[Event]:
        """End what is on: nobody looks there any more."""
        self.panel.acknowledge(t_s)
        return [self._go_on(kind, reason, t_s, "end") for kind in self.open_events]

    def has_clip(self, event_id: str, clip: str | None) -> None:
        """Note which clip is made of an alarm that is on; its further phases name it."""
        if (alarm := self._open.get("alarm")) is not None and alarm.id == event_id:
            self._open["alarm"] = replace(alarm, clip=clip)

    def _step(
        self, steps: list[PanelChange], t_s: float, peak: float = 0.0, dwell: Dwell | None = None
    ) -> list[Event]:
        return [
            self._begin("alarm", step.reason, t_s, peak, dwell)
            if step.kind == "new"
            else self._go_on("alarm", step.reason, t_s, step.kind)
            for step in steps
        ]

    def _follow(
        self, kind: EventKind, reason: str | None, *, t_s: float, dwell: Dwell | None = None
    ) -> list[Event]:
        old = self._open.get(kind)
        if old is None:
            return [] if reason is None else [self._begin(kind, reason, t_s, 0.0, dwell)]
        if reason is None:
            return [self._go_on(kind, old.reason, t_s, "end")]
        if kind == "tamper" and reason != old.reason:
            return [self._go_on(kind, reason, t_s, "update")]
        return []

    def _begin(
        self, kind: EventKind, reason: str, t_s: float, peak: float, dwell: Dwell | None
    ) -> Event:
        event = self._open[kind] = Event(
            id=_ulid(f"{kind} {t_s:.6f}{self._run}", t_s, dwell),
            kind=kind,
            t_s=t_s,
            start_t_s=t_s,
            peak=peak,
            reason=reason,
        )
        return event

    def _go_on(self, kind: EventKind, reason: str, t_s: float, phase: Phase) -> Event:
        end_t_s = t_s if phase == "end" else None
        event = replace(self._open[kind], phase=phase, t_s=t_s, end_t_s=end_t_s, reason=reason)
        self._open[kind] = event
        if phase == "end":
            del self._open[kind]
        return event


def _ulid(what: str, t_s: float, dwell: Dwell | None) -> str:
    digest = hashlib.blake2b(what.encode(), digest_size=10)
    if dwell is not None:
        digest.update(dwell.frames[-1].tobytes())
    number = (int(t_s * 1000) & (1 << 48) - 1) << 80 | int.from_bytes(digest.digest(), "big")
    return "".join(_CROCKFORD[number >> 5 * k & 31] for k in range(25, -1, -1))
