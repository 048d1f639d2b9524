"""RadarRun: one radar from its port to its records; threads, parts and state of its own.

Threads: the *reader* takes frames from the source, converts them and pushes them into the
ring; the *worker* (`radard.run.worker`) takes dwells, decides, and writes to the outputs;
*clips* writes evidence. Nothing here is shared with another radar of the process but the outputs.
"""

import threading
import uuid
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from radard.alarm.events import trial_alarm
from radard.alarm.panel import ARM_MODES
from radard.config.config import Config
from radard.config.quiet_hours import Now, recorded_clock, wall_clock
from radard.errors import RadardError, UsageError
from radard.health.health import STALE_S, Health, Status
from radard.outputs.base import COMMANDS
from radard.outputs.fanout import Feed, Host, Outputs
from radard.outputs.records import Record, event_record, hello_record, marked, status_record
from radard.pipeline import Pipeline
from radard.run.components import (
    Parts,
    classifier_for,
    logger_of,
    make_classifier,
    make_parts,
    make_store,
    remake_parts,
)
from radard.run.tap import Tap
from radard.run.worker import Worker
from radard.stream.frame_timing import RateWatch
from radard.stream.playback import Playback
from radard.stream.ring import FrameRing, Notice
from radard.stream.source import FrameSource, Notify, open_source, speed_factor
from x2radar.ports import parse_port

Reload = Callable[[], Config]
_JOIN_S = 1.5  # for each thread; chosen: all of them within the 4.5 s of a forced end
_KEPT_COMMANDS = (*ARM_MODES, "disarm")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """What only the command line can say."""

    duration_s: float | None = None  # stream seconds after which to stop
    record: Path | None = None  # write the frames into this recording as well
    stdout_is_terminal: bool = False  # whether a person reads stdout
    reload: Reload | None = None  # reads the configuration again, as at the start


class RadarRun:
    """Run one radar: `open`, `prepare`, `start`, and `finish` once it is over or stopped.

    `wake` is called from another thread when the work is over; `reload` asks for the configuration
    to be read again, as SIGHUP does. Raises UsageError if there is no port or its speed makes no
    sense, BundleError or ModelMismatch if the model cannot be had.
    """

    def __init__(
        self,
        config: Config,
        options: RunOptions,
        wake: Callable[[], None],
        reload: Callable[[], None],
    ) -> None:
        if config.sensor.port is None:
            msg = "no port: give --port /dev/ttyACM0, sim:SCENE or replay:FILE"
            raise UsageError(msg)
        self._port = config.sensor.port
        self._config = config
        self._options = options
        self._wake = wake
        self.log = logger_of(config)
        self.name = config.sensor.name
        self._classifier = make_classifier(config)
        self._factor = speed_factor(config.sensor.speed, parse_port(self._port))
        self.health = Health(stale_s=STALE_S * max(1.0, 1.0 / (self._factor or 1.0)))
        self.worker: Worker | None = None
        self.failure: BaseException | None = None
        """What ended the work, if that was no end of the stream."""
        self._source: FrameSource | None = None
        self._end_wait: Callable[[], None] = lambda: None
        self._pipeline: Pipeline | None = None
        self._ring: FrameRing | None = None
        self._feed: Feed | None = None
        self._outputs: Outputs | None = None
        self._now: Now = wall_clock
        self._waiting_command: str | None = None
        self._is_finished = False
        self._threads: list[threading.Thread] = []
        self.host = Host(
            self.name,
            self.health,
            self.panel,
            self.command,
            config=lambda: self.config,
            ring=lambda: self._ring,
            playback=self._playback,
            driver=self._driver,
            reload=reload,
            test_alarm=self.test_alarm,
            mark=lambda: self.mark,
        )

    @property
    def config(self) -> Config:
        """What holds now."""
        return self.worker.parts.config if self.worker is not None else self._config

    @property
    def can_wait(self) -> bool:
        """Whether the stream can wait for a slow output, as far as is known by now."""
        return not self._is_live or self._factor is None

    @property
    def mark(self) -> str:
        """What records and topics must say of the stream, see `Host.mark`."""
        if self._config.sensor.kind == "sim":
            return "simulated"
        return "" if self._is_live else "replayed"

    @property
    def _is_live(self) -> bool:
        return self._source.is_live if self._source else self._config.sensor.kind != "replay"

    @property
    def parts(self) -> Parts:
        """What the worker works with; there is none before the port is open."""
        assert self.worker is not None  # noqa: S101 - as said
        return self.worker.parts

    @property
    def is_working(self) -> bool:
        """Whether the worker works."""
        return bool(self._threads) and self._threads[1].is_alive()

    @property
    def is_kept(self) -> bool:
        """Whether how it is armed would outlive a kill."""
        return self.worker is None or self.worker.is_kept

    def panel(self) -> dict[str, object]:
        """See `Host.panel`."""
        panel = dict(self.worker.panel()) if self.worker is not None else {}
        return {**panel, self.mark: True} if self.mark else panel

    def command(self, name: str) -> None:
        """See `Host.command`; what comes without a stream holds for the next one."""
        if name not in COMMANDS:
            msg = f"no command '{name}'; known are {', '.join(COMMANDS)}"
            raise ValueError(msg)
        if self.worker is not None and not self._is_finished:
            self.worker.command(name)
        elif name in _KEPT_COMMANDS:
            self.log.warning("%s: holds once there is a stream", name)
            self._waiting_command = name

    def try_alarm(self) -> None:
        """Send a test alarm through all outputs; raises ValueError while a real one is on."""
        if self.panel().get("alarm_id"):
            msg = "an alarm is on: acknowledge it first"
            raise ValueError(msg)
        if self.worker is not None and not self._is_finished:
            self.worker.try_alarm()
        elif self._feed is not None:
            for event in trial_alarm(0.0):
                self._feed.put(event_record(event), waits=False)

    def test_alarm(self, halt: threading.Event | None = None) -> list[dict[str, str]]:
        """See `Host.test_alarm`; `halt` ends the wait for answers."""
        outputs = self._outputs
        return outputs.try_alarm(self.name, self.try_alarm, halt) if outputs is not None else []

    def bind(self, outputs: Outputs) -> None:
        """Take the outputs that records go to."""
        sensor = self.name if self._config.is_one_of_several else None
        self._outputs = outputs
        self._feed = Feed(outputs, sensor, lambda: self.mark)

    def open(self, on_notice: Notify, *, is_wanted: Callable[[], bool] = lambda: True) -> None:
        """Open the port, which may mean to wait for a device; raises as `open_source` does.

        `on_notice` is told what happens to the device before there is a stream; `is_wanted` is
        asked before a wait begins that `stop` could no longer end.
        """

        def notice(kind: str, reason: str) -> None:
            if self._ring is not None:
                self._ring.post(kind, reason)
                return
            self.log.warning("%s: %s", kind, reason)
            self.health.on_notice(Notice(kind, reason, 0.0))
            on_notice(kind, reason)

        def on_wait(close: Callable[[], None]) -> None:
            self._end_wait = close
            if not is_wanted():
                close()

        sensor = self._config.sensor
        self._source = self._ring = None
        self._source = open_source(
            self._port,
            speed=sensor.speed,
            # One of several must not keep the others from their work.
            wait=sensor.wait or self._config.is_one_of_several,
            quit_on_loss=sensor.on_device_loss == "quit",
            on_notice=notice,
            on_wait=on_wait,
        )

    def prepare(self) -> Tap:
        """Make what fits the stream; return the tap of its frames, to be closed by the caller.

        Raises ModelMismatch, FeatureError or RecordingError if model or recording do not fit it.
        """
        assert self._source is not None  # noqa: S101 - `open` came before
        stream = self._source.stream
        if self._source.is_live and not stream.run_id:
            # A plug-in's: its runs must not share ids either.
            stream = replace(stream, run_id=uuid.uuid4().hex)
        self._classifier = classifier_for(stream, self._config, self._classifier)
        self._pipeline = Pipeline(stream, self._config, self._classifier)
        return Tap(self._options.record, stream)

    def start(self, tap: Tap) -> None:
        """Begin to work, in threads; the first record is this run's `hello`.

        Raises ConfigError if a calibration that was named does not fit.
        """
        source, pipeline, feed = self._source, self._pipeline, self._feed
        assert source is not None  # noqa: S101 - `open`, `prepare` and `bind` came before
        assert pipeline is not None  # noqa: S101
        assert feed is not None  # noqa: S101
        if not source.is_live:
            self._now = recorded_clock(getattr(source, "started_utc", ""))
        ring = pipeline.make_ring()
        parts = make_parts(self._config, pipeline, now=self._now, is_live=source.is_live)
        store = make_store(self._config, is_live=source.is_live)
        # What comes faster or slower on purpose says nothing about the module.
        is_real_time = source.is_live and self._factor == 1.0
        rate = RateWatch(source.stream.frame_rate_hz) if is_real_time else None
        worker = Worker(parts, ring, feed, self.health, store, rate=rate)
        self.worker, self._ring = worker, ring
        self._is_finished = False
        expect = getattr(source, "expect", None)
        if expect is not None:
            expect(ring.due_s)
        warning = getattr(source, "warning", None)
        if warning:
            self.log.warning("%s", warning)
        feed.put(self.hello(parts))
        feed.put(status_record(self.health.status))
        self._threads = [
            self._thread("reader", lambda: self._read(source, ring, tap, worker)),
            self._thread("worker", lambda: self._work(worker, pipeline)),
        ]
        for thread in self._threads:
            thread.start()
        name, self._waiting_command = self._waiting_command, None
        if name is not None:
            worker.command(name)

    def hello(self, parts: Parts) -> Record:
        """Return the record that a run with these parts begins with."""
        assert self.worker is not None  # noqa: S101 - `start` came before
        is_armed = self.worker.tracker.panel.is_armed
        hello = hello_record(parts.pipeline, parts.config, is_armed=is_armed)
        module = getattr(self._source, "module", None)
        return marked({**hello, "module": module}, self.mark)

    def stop(self) -> None:
        """Ask for the end, also of waiting for a device; any thread may."""
        if self.worker is not None:
            self.worker.stop()
        if self._ring is not None:
            self._ring.end()
            self._ring.stop()
        self._end_wait()
        self.close()

    def close(self) -> None:
        """Let go of the port."""
        if self._source is not None:
            self._source.close()

    def finish(self) -> list[str]:
        """Wait a moment for the threads and close what is theirs; return those that are stuck."""
        for thread in reversed(self._threads):
            thread.join(_JOIN_S)
        self._is_finished = True
        stuck = [thread.name for thread in self._threads if thread.is_alive()]
        self._threads = []
        self.failure = (self.worker.failure if self.worker else None) or self.failure
        if stuck and self.failure is None:
            self.failure = RadardError(f"stuck and left behind: {', '.join(stuck)}")
        clips = self.worker.parts.clips if self.worker is not None else None
        if clips is not None and not clips.close(_JOIN_S):
            self.log.warning("the last clip may lack its end: the disk is too slow")
        return stuck

    def tell(self, status: Status | None) -> None:
        """Hand on a change of state, once there are outputs; not waiting for them."""
        if status is not None and self._feed is not None:
            self._feed.put(status_record(status), waits=False)

    def remade(self, config: Config) -> Parts | None:
        """Return the parts for a configuration that was read again; None without a stream.

        Raises RadardError if it cannot hold; the old one then stays.
        """
        if self.worker is None or self._source is None:
            return None
        is_live = self._source.is_live
        return remake_parts(config, self.worker.parts, now=self._now, is_live=is_live)

    def exchange(self, parts: Parts) -> None:
        """Work with other parts from the next item on."""
        assert self.worker is not None  # noqa: S101 - there were parts to remake
        self.worker.exchange(parts)

    def _thread(self, name: str, target: Callable[[], None]) -> threading.Thread:
        full = f"{self.name} {name}" if self._config.is_one_of_several else name
        return threading.Thread(target=target, name=full, daemon=True)

    def _playback(self) -> Playback | None:
        playback: Playback | None = getattr(self._source, "playback", None)
        return playback

    def _driver(self) -> Mapping[str, int]:
        stats = getattr(self._source, "stats", None)
        return asdict(stats) if stats is not None else {}

    def _read(self, source: FrameSource, ring: FrameRing, tap: Tap, worker: Worker) -> None:
        most = None
        if self._options.duration_s is not None:
            most = max(1, round(self._options.duration_s * source.stream.frame_rate_hz))
        first = None
        try:
            for frame in source.frames():
                first = frame.index if first is None else first
                if most is not None and frame.index - first >= most:
                    break
                tap.write(frame)
                worker.hold(frame)
                if not ring.push(frame):
                    break
        except BaseException as err:  # noqa: BLE001 - handed over to `finish`
            self.failure = err
        finally:
            ring.end()

    def _work(self, worker: Worker, pipeline: Pipeline) -> None:
        if not self.can_wait:
            # While the frames of the first dwell come in.
            pipeline.warm_up()
        worker.run()
        self._wake()
