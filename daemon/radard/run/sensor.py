"""Sensor: one radar of the process, with or without a stream.

It is what outputs, control and reloads talk to. It opens its port, which gives an `OpenedSensor`,
and starts that, which gives a `RunningSensor` (`radard.run.running`). Nothing of it is shared with
another radar but the outputs and the pool of workers.
"""

import math
import threading
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from radard.alarm.events import EventTracker, trial_alarm
from radard.alarm.panel import AlarmPanel, AlarmPolicy
from radard.alarm.sensor_state import SensorState, StateStore
from radard.config.config import Config
from radard.config.quiet_hours import recorded_clock, wall_clock
from radard.errors import UsageError
from radard.health.health import STALE_S, Health, Status
from radard.log_file import MARKS
from radard.outputs.base import COMMANDS, Sink
from radard.outputs.fanout import Outputs
from radard.outputs.records import Record, ended_record, event_record, marked, status_record
from radard.outputs.registry import tried
from radard.pipeline import Pipeline
from radard.run.components import (
    Parts,
    classifier_for,
    hello_of,
    logger_of,
    make_classifier,
    make_parts,
    make_store,
    remake_parts,
    without_restart,
)
from radard.run.pool import WorkerPool
from radard.run.running import OpenedSensor, RunningSensor
from radard.run.tap import Tap
from radard.run.worker import Worker
from radard.stream.frame_timing import RateWatch
from radard.stream.playback import Playback
from radard.stream.ring import FrameRing, Notice
from radard.stream.source import FrameSource, Notify, open_source, speed_factor
from x2radar.ports import parse_port

_RECENT = 20  # records: a screen of decisions, and what happened among them


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """Options that stand on the command line alone."""

    duration_s: float | None = None  # stream seconds after which to stop
    record: Path | None = None  # write the frames into this recording as well
    stdout_is_terminal: bool = False  # whether a person reads stdout
    reload: Callable[[], Config] | None = None  # reads the configuration again, as at the start


class Sensor:
    """One radar; a `radard.outputs.base.Host`, for any thread."""

    def __init__(
        self,
        config: Config,
        options: RunOptions,
        outputs: Outputs,
        pool: WorkerPool,
        ask_reload: Callable[[], None] = lambda: None,
    ) -> None:
        if config.sensor.port is None:
            raise UsageError("no port: give --port /dev/ttyACM0, sim:SCENE or replay:FILE")
        self._port = config.sensor.port
        self._config = config
        self._options = options
        self._outputs = outputs
        self._pool = pool
        self.reload = ask_reload
        self.log = logger_of(config)
        self.sensor = config.sensor.name
        self._told_as = self.sensor if config.is_one_of_several else None  # in records
        self._classifier = make_classifier(config)
        self._is_live = config.sensor.kind != "replay"
        self._factor = speed_factor(config.sensor.speed, parse_port(self._port))
        self.health = Health(stale_s=STALE_S * max(1.0, 1.0 / (self._factor or 1.0)))
        self.halt = threading.Event()  # the end was asked for
        self._end_wait: Callable[[], None] = lambda: None
        self._run: RunningSensor | None = None
        self._store: StateStore | None = None  # from the first stream or command on
        self._commanding = threading.Lock()
        self._has_said_hello = False
        self._n_decided = 0
        self.recent: tuple[Record, ...] = ()  # its last decisions and events, the oldest first

    def config(self) -> Config:
        return self._run.worker.parts.config if self._run is not None else self._config

    def panel(self) -> SensorState | None:
        return self._run.worker.state if self._run is not None else None

    def ring(self) -> FrameRing | None:
        return self._run.ring if self._run is not None else None

    def playback(self) -> Playback | None:
        return getattr(self._run.opened.source, "playback", None) if self._run else None

    def driver(self) -> Mapping[str, int]:
        stats = getattr(self._run.opened.source, "stats", None) if self._run else None
        return asdict(stats) if stats is not None else {}

    def sinks(self) -> Sequence[Sink]:
        return [sink for _, sink in self._outputs.sinks]

    def mark(self) -> str:
        if self._config.sensor.kind == "sim":
            return "simulated"
        return "" if self._is_live else "replayed"

    def command(self, name: str) -> None:
        """As in `Host`; what comes without a stream is kept for the next one."""
        if name not in COMMANDS:
            raise ValueError(f"no command '{name}'; known are {', '.join(COMMANDS)}")
        with self._commanding:
            if (worker := self.worker) is not None:
                worker.command(name)
            elif name == "calibrate":
                raise ValueError("calibrate: there is no stream yet")
            else:
                self._command_alone(name)

    def test_alarm(self, halt: threading.Event | None = None) -> list[dict[str, str]]:
        """Send a test alarm; return what every output made of it. `halt` ends the wait."""
        sinks = [sink for of, sink in self._outputs.sinks if of in {None, self.sensor}]
        return tried(sinks, self._try_alarm, halt)

    @property
    def why_lost(self) -> str | None:
        """Why a kill would undo a command, as `EventLog.why_lost`."""
        return self._kept_state().why_lost(self.panel())

    @property
    def can_wait(self) -> bool:
        """Whether the stream can wait for a slow output, as far as is known by now."""
        return not self._is_live or self._factor is None

    @property
    def worker(self) -> Worker | None:
        """Who works on the stream; None when nobody does."""
        run = self._run
        return run.worker if run is not None and not run.over.is_set() else None

    def put(self, record: Record, *, waits: bool = True) -> bool:
        """Hand a record to the outputs, which learn whose it is; see `Outputs.put`."""
        if self._told_as is not None:
            record = {**record, "sensor": self._told_as}
        if record["type"] in {"decision", "event"}:
            self.recent = (*self.recent[1 - _RECENT :], record)
        return self._outputs.put(marked(record, self.mark()), self._told_as, waits=waits)

    def owns(self, record: Mapping[str, object]) -> bool:
        """Return whether an event of this run or of an earlier one is of this radar."""
        mark = next((mark for mark in MARKS if record.get(mark)), "")
        return record.get("sensor") == self._told_as and mark == self.mark()

    def tell(self, status: Status | None) -> None:
        """Hand on a change of state, not before the `hello`, not waiting for the outputs."""
        if status is not None and (self._has_said_hello or self._told_as is not None):
            self.put(status_record(status), waits=False)

    def complain(self, source: str, reason: str) -> None:
        """Note what is wrong beside the stream, and tell of it; an empty reason takes it back."""
        self.tell(self.health.complain(source, reason))

    def open(self, on_notice: Notify) -> OpenedSensor:
        """Open the port, which may mean to wait for a device, and what fits its stream."""

        def notice(kind: str, reason: str) -> None:
            if (run := self._run) is not None:
                run.ring.post(kind, reason)
                return
            self.log.warning("%s: %s", kind, reason)
            self.health.on_notice(Notice(kind, reason, 0.0))
            on_notice(kind, reason)

        def on_wait(close: Callable[[], None]) -> None:
            self._end_wait = close
            if self.halt.is_set():
                close()

        sensor = self._config.sensor
        source = open_source(
            self._port,
            speed=sensor.speed,
            # One of several must not keep the others from their work.
            wait=sensor.wait or self._told_as is not None,
            quit_on_loss=sensor.on_device_loss == "quit",
            on_notice=notice,
            on_wait=on_wait,
            due_s=lambda: run.ring.due_s() if (run := self._run) is not None else math.inf,
        )
        self._end_wait = source.close
        self._is_live = source.is_live
        self._opened_with = self._config
        try:
            stream = source.stream
            if source.is_live and not stream.run_id:
                # A plug-in's: its runs must not share ids either.
                stream = replace(stream, run_id=uuid.uuid4().hex)
            self._classifier = classifier_for(stream, self._config, self._classifier)
            pipeline = Pipeline(stream, self._config, self._classifier)
            tap = Tap(
                self._options.record,
                stream,
                free_bytes=self._config.clips.free_mb * 1e6,
                complain=lambda reason: self.complain("recording", reason),
                waits=self.can_wait,
            )
        except BaseException:
            source.close()
            raise
        return OpenedSensor(source, pipeline, tap)

    def make_worker(self, opened: OpenedSensor) -> Worker:
        """Return who works on an opened stream, beginning with `hello`; ConfigError if unfit."""
        source = opened.source
        now = wall_clock if source.is_live else recorded_clock(getattr(source, "started_utc", ""))
        parts = make_parts(self._config, opened.pipeline, now=now, is_live=source.is_live)
        # What comes faster or slower on purpose says nothing about the module.
        is_real_time = source.is_live and self._factor == 1.0
        rate = RateWatch(source.stream.frame_rate_hz if is_real_time else None)
        worker = Worker(parts, self.put, self.health, self._kept_state(), rate=rate)
        worker.n_decided = self._n_decided
        if warning := getattr(source, "warning", None):
            self.log.warning("%s", warning)
        hello = self._hello(worker, parts, source)
        if hello["taken"]:
            self.log.warning("taken from files that nobody named: %s", "; ".join(hello["taken"]))
        self.put(hello)
        self._has_said_hello = True
        self.put(status_record(self.health.status))
        kept = {event.id for event in worker.tracker.open_events.values()}
        for record in self._outputs.log.open_events():
            if self.owns(record) and record["id"] not in kept:
                self.put(ended_record(record))
        return worker

    def start(self, opened: OpenedSensor) -> RunningSensor:
        """Begin to work on an opened stream; raises as `make_worker` does."""
        with self._commanding:
            worker, duration_s = self.make_worker(opened), self._options.duration_s
            self._run = run = RunningSensor(opened, worker, self._pool, duration_s)
        run.start()
        if self._config is not self._opened_with:
            # Read again while the stream was opened.
            self.reload()
        return run

    def end_events(self, reason: str) -> None:
        """End what is on in a run that is over, as there will be no other one."""
        if self._run is not None:
            self._run.worker.end_events(reason)

    def leave(self) -> None:
        """Let go of a run that is over: there is no stream until the next one."""
        if (run := self._run) is not None:
            worker = run.worker
            self._config, self._n_decided, self._run = worker.parts.config, worker.n_decided, None

    def look_up(self) -> None:
        """Have its worker look whether nothing comes; returns at once."""
        if (worker := self.worker) is not None:
            worker.ring.post("look", call=lambda _t_s: worker.look_up())

    def stop(self) -> None:
        """Ask for the end, also of waiting for a device."""
        self.halt.set()
        if self._run is not None:
            self._run.stop()
        self._end_wait()

    def remake(self, config: Config) -> Callable[[], Record | None]:
        """Return what lets a configuration hold that was read again; raises if it cannot.

        That returns the `hello` that says so; without a stream it waits for one, and says nothing.
        """
        if (run := self._run) is None:
            was, config = self._config, without_restart(config, self._config)
            known = self._classifier if config.model == was.model else make_classifier(config)

            def hold() -> None:
                self._config, self._classifier = config, known
                if self._run is not None:
                    # A stream has come since.
                    self.reload()

            return hold
        opened, worker = run.opened, run.worker
        parts = remake_parts(config, worker.parts, is_live=opened.source.is_live)

        def exchange() -> Record:
            worker.exchange(parts)
            return self._hello(worker, parts, opened.source)

        return exchange

    def _kept_state(self) -> StateStore:
        """Return what outlives the runs of its streams; the outputs are open."""
        if self._store is None:
            self._store = make_store(self._config, self._outputs.log, is_live=self._is_live)
        return self._store

    def _command_alone(self, name: str) -> None:
        """Take a command without a stream: an alarm that is kept ends at once."""
        self.log.warning("%s: there is no stream yet", name)
        store, alarm = self._kept_state(), self._config.alarm
        kept = store.load(is_armed=alarm.armed)
        if kept.entry_reason is not None and name != "disarm":
            # Its alarm begins with the stream.
            return
        policy = AlarmPolicy(exit_delay_s=alarm.exit_delay_s)
        tracker = EventTracker(AlarmPanel(policy, is_armed=kept.is_armed, mode=kept.mode))
        tracker.resume(kept)
        events = tracker.on_command(name, 0.0)
        # Nobody was told of one that an entry delay would have become.
        for event in events if kept.alarm_id is not None else ():
            self.put(event_record(event), waits=False)
        store.save(tracker.kept(0.0))

    def _try_alarm(self) -> None:
        if (state := self.panel()) is not None and state.alarm_id:
            raise ValueError("an alarm is on: acknowledge it first")
        if (worker := self.worker) is not None:
            # Between two decisions, so that no output takes its end for that of a real alarm.
            worker.ring.post("test", call=self._send_trial)
        else:
            self._send_trial(0.0)

    def _send_trial(self, t_s: float) -> None:
        if (state := self.panel()) is None or not state.alarm_id:
            for event in trial_alarm(t_s):
                self.put(event_record(event), waits=state is not None)

    def _hello(self, worker: Worker, parts: Parts, source: FrameSource) -> Record:
        is_armed, has_state = worker.tracker.panel.is_armed, self._kept_state().has_kept
        hello = hello_of(parts, source, is_armed=is_armed, has_state=has_state)
        return marked(hello, self.mark())
