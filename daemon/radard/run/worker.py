"""Worker: one radar's dwells become decisions, events and records, one item after the other.

Threads of a pool (`radard.run.pool`) lend themselves to it. All that it knows of time is stream
time, but for the two things that ask for the clock on the wall: quiet periods of a live stream,
and silence.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module

from radard.alarm.events import Event, EventTracker
from radard.alarm.panel import ARM_MODES, AlarmPanel
from radard.alarm.sensor_state import SensorState, StateStore
from radard.health.health import Health, Status
from radard.judge.decision import Decision, invalid_decision
from radard.outputs.records import Record, decision_record, event_record, status_record
from radard.run.components import Parts, logger_of, room_of
from radard.run.room_calibration import RoomCalibration, can_calibrate
from radard.stream.frame_timing import RateWatch
from radard.stream.ring import Dwell, Notice
from x2radar.frame import Frame


class Worker:
    """Work on one stream: dwells and notices of the ring become records, which `put` hands on."""

    def __init__(
        self,
        parts: Parts,
        put: Callable[[Record], object],
        health: Health,
        store: StateStore,
        *,
        rate: RateWatch | None = None,
    ) -> None:
        self.parts = parts
        self._rate = rate or RateWatch(None)
        self.ring = parts.pipeline.make_ring()  # of which it works on what comes
        self._put = put
        self._health = health
        self._store = store
        self.n_decided = 0  # number of the last decision; of a sensor that works again it goes on
        self._t_s = 0.0
        self._last: Decision | None = None
        config = parts.config
        self._log = logger_of(config)
        kept = store.load(is_armed=config.alarm.armed)
        if kept.is_armed != config.alarm.armed:
            word = "armed" if kept.is_armed else "disarmed"
            self._log.warning("%s, as the last command said", word)
        panel = AlarmPanel(parts.policy, is_armed=kept.is_armed, mode=kept.mode)
        sensor = f" {config.sensor.name}" if config.is_one_of_several else ""
        run = f" {parts.pipeline.stream.run_id}{sensor}"
        self.tracker = EventTracker(panel, config.zones, parts.pet_limit, run)
        self._kept_events = self.tracker.resume(kept)
        self._is_moved = False
        self._room: RoomCalibration | None = None

    @property
    def state(self) -> SensorState:
        """What holds now; for any thread."""
        events, panel = self.tracker.open_events, self.tracker.panel
        alarm, last = events.get("alarm"), self._last
        return SensorState(
            armed=panel.is_armed,
            mode=panel.mode,
            panel=panel.state,
            delay_left_s=panel.left_s(self._t_s),
            sensitivity=self.parts.config.alarm.sensitivity,
            alarm_id=alarm.id if alarm else None,
            open={kind: event.reason for kind, event in events.items()},
            t_s=round(self._t_s, 3),
            seq=last.seq if last else 0,
            gate=last.gate if last else None,
            label=last.label if last else None,
            clock_drift=self._rate.drift,
            calibration=self._room.progress if self._room is not None else None,
        )

    def command(self, name: str) -> None:
        """Queue a command, see `Host.command`; for any thread."""
        if name == "calibrate":
            # Its scipy takes a second or more to load: here no decision waits for it.
            import_module("radard.detect.survey")
        self.ring.post("command", call=partial(self._take_command, name))

    def exchange(self, parts: Parts) -> None:
        """Work with other parts from the next item on; for any thread."""
        self.ring.post("reload", call=lambda _t_s: self._take_parts(parts))

    def hold(self, frame: Frame) -> None:
        """Hold a frame for a clip; for the reader."""
        if (clips := self.parts.clips) is not None:
            clips.push(frame)

    def begin(self) -> None:
        """Tell what the last run has left: an alarm that is on, say."""
        self._emit(self._kept_events)

    def end_events(self, reason: str) -> None:
        """End what is on, once the stream is over and will not begin again."""
        self._emit(self.tracker.end_all(reason, self._t_s))
        self._keep(self._t_s)

    def close(self, timeout_s: float) -> None:
        """End what works beside it; the stream is over."""
        if self._room is not None:
            self._room.stop("the run ended")
        if (clips := self.parts.clips) is not None and not clips.close(timeout_s):
            self._log.warning("the last clip may lack its end: the disk is too slow")

    def look_up(self) -> None:
        """Report an event if no frames or decisions have come for too long."""
        self._tell(self._health.check())
        # Who complains of an output may have been the first to tell, but begins no event.
        if (status := self._health.status).state == "offline":
            self._emit(self.tracker.on_notice(Notice("silent", status.reason, self._t_s)))

    def handle(self, item: Dwell | Notice) -> None:
        """Work on the next item of the ring."""
        if isinstance(item, Dwell):
            self._take_dwell(item)
        elif item.call is not None:
            item.call(item.t_s)
        else:
            self._take_notice(item)

    def _take_dwell(self, dwell: Dwell) -> None:
        parts = self.parts
        self.n_decided += 1
        self._is_moved = False
        if self._room is not None and (made := self._room.take(dwell)) is not None:
            parts.pipeline.use(made)
            self._relearn_tamper(self._t_s)
        decision = replace(self._decide(dwell), seq=self.n_decided)
        self._last, self._t_s = decision, decision.t_s
        self._tell(self._health.on_decision(decision))
        record = decision_record(decision)
        self._put(record)
        if parts.clips is not None:
            parts.clips.on_decision(record, decision.t_s)
        was = self.tracker.panel.state
        tamper = parts.pipeline.tamper
        if tamper is not None and (room := tamper.take_due()) is not None:
            parts.room.save(room)
        fault = decision.fault if decision.gate != "invalid" else ""
        fault = fault or self._rate.note(dwell.t_s, dwell.t_mono_s) or parts.zone_fault
        is_quiet = parts.quiet.holds(decision.t_s)
        events = self.tracker.on_decision(decision, dwell, is_quiet=is_quiet, fault=fault)
        told = self._emit(events)
        if self.tracker.panel.state != was:
            self._keep(decision.t_s)
        self._tell(self._health.complain("sensor", fault))
        self._after_clip(decision.t_s, told)

    def _decide(self, dwell: Dwell) -> Decision:
        try:
            return self.parts.pipeline.decide(dwell)
        except Exception as err:  # noqa: BLE001 - logged below, with its traceback
            # Whatever it is: announced as a fault and tried again is better than silence.
            self._log.exception("a dwell could not be judged")
            return invalid_decision(dwell, f"internal error: {err!r}")

    def _take_notice(self, notice: Notice) -> None:
        if notice.kind == "restart":
            self.parts.pipeline.restart()
            if self.parts.clips is not None:
                self.parts.clips.restart()
        self._rate.reset()
        if notice.kind in {"restart", "lost"} and self._room is not None:
            self._room.stop(f"the stream broke off ({notice.reason})")
        if notice.kind == "paused":
            # Somebody holds a replay on purpose: nothing is wrong with it.
            self._tell(self._health.on_notice(notice))
            return
        if notice.kind == "moved" or (notice.kind == "restart" and self._is_moved):
            # Nor when somebody goes on elsewhere, or it begins again.
            self._is_moved = notice.kind == "moved"
            self._log.info("%s", notice.reason)
            return
        self._log.warning("%s: %s", notice.kind, notice.reason)
        self._tell(self._health.on_notice(notice))
        self._emit(self.tracker.on_notice(notice))

    def _take_command(self, name: str, t_s: float) -> None:
        self._log.info("command: %s", name)
        if name == "calibrate":
            self._calibrate(t_s)
        elif name in ARM_MODES and not self._may_arm(t_s):
            return
        else:
            self._emit(self.tracker.on_command(name, t_s))
        self._keep(t_s)

    def _keep(self, t_s: float) -> None:
        self._store.save(self.tracker.kept(t_s))

    def _may_arm(self, t_s: float) -> bool:
        """Tell people who arm while a tamper event is on; return whether the sensor is armed."""
        on = self.tracker.open_events.get("tamper")
        if on is None or self.tracker.panel.is_armed:
            return True
        is_refused = self.parts.config.alarm.arm_with_tamper == "refuse"
        word = "arming was refused" if is_refused else "armed all the same"
        self._log.warning("%s: tamper: %s", word, on.reason)
        self._emit(self.tracker.remark("tamper", word, t_s))
        return not is_refused

    def _calibrate(self, t_s: float) -> None:
        config, pipeline = self.parts.config, self.parts.pipeline
        if not can_calibrate(config):
            # No calibration is wanted: the gate learns the room again, as at the start.
            pipeline.restart()
            self._relearn_tamper(t_s)
            return
        if self._room is not None:
            self._room.stop("another one was asked for")
        self._room = RoomCalibration(config, pipeline, t_s)

    def _relearn_tamper(self, t_s: float) -> None:
        """Take what is there now for the room; nothing else ends a tamper that lasts."""
        parts = self.parts
        if parts.pipeline.tamper is not None:
            self._emit(self.tracker.remark("tamper", "taken for the room: it was calibrated", t_s))
            parts.pipeline.tamper.relearn()
            parts.room.forget(room_of(parts.config, parts.pipeline))

    def _take_parts(self, parts: Parts) -> None:
        if self.parts.clips is not None and self.parts.clips is not parts.clips:
            self.parts.clips.close(0.0)
        if self._room is not None and parts.config.gate != self.parts.config.gate:
            self._room.stop("the gate's settings were changed")
        self.parts = parts
        parts.pipeline.verdict.pet_limit = parts.pet_limit
        self.tracker.panel.policy = parts.policy
        self.tracker.zones, self.tracker.pet_limit = parts.config.zones, parts.pet_limit

    def _after_clip(self, t_s: float, events: Sequence[Event]) -> None:
        clips = self.parts.clips
        if clips is None:
            return
        alarm = next((event_record(e) for e in reversed(events) if e.kind == "alarm"), None)
        clips.after(t_s, is_seen=self.tracker.panel.is_seen, event=alarm)
        self._tell(self._health.complain("clips", clips.complaint))
        on = self.tracker.open_events.get("alarm")
        if on is not None and (clips.complaint or on.clip is None):
            self.tracker.has_clip(on.id, None if clips.complaint else clips.named_of(on.id))

    def _emit(self, events: Sequence[Event]) -> list[Event]:
        """Tell events; return them with the clip that a new alarm begins."""
        told = [self._with_clip(event) for event in events]
        if any(event.kind == "alarm" and event.phase != "end" for event in told):
            # First: an alarm of which somebody was told must still be on after a kill. That one is
            # over is kept by the caller, once the outputs have been told.
            self._keep(told[-1].t_s)
        for event in told:
            self._put(event_record(event))
        return told

    def _with_clip(self, event: Event) -> Event:
        clips = self.parts.clips
        if event.kind != "alarm" or event.phase != "new" or clips is None:
            return event
        clip = clips.begin(event_record(event), event.t_s)
        self.tracker.has_clip(event.id, clip)
        return replace(event, clip=clip)

    def _tell(self, status: Status | None) -> None:
        if status is not None:
            self._log.info("%s %s", status.state, status.reason)
            self._put(status_record(status))
