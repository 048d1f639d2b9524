"""Service: threads, signals, sinks; runs one radar until its stream or the user ends it.

Threads: the reader takes frames from the source, converts them and pushes them into the
ring; the main thread takes dwells, decides, and writes to the sinks.
"""

import logging
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from radard.classifier import Classifier, load_bundle
from radard.config import Config
from radard.errors import UsageError
from radard.events import EventTracker
from radard.health import Health, Status
from radard.output import (
    Record,
    decision_record,
    event_record,
    hello_record,
    status_record,
    utc_now,
)
from radard.pipeline import Pipeline
from radard.ring import Dwell, FrameRing, Notice
from radard.sinks import open_sinks
from radard.sinks.base import Sink
from radard.source import FrameSource, open_source
from x2radar.frame import Frame

log = logging.getLogger("radard")
_JOIN_S = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """What only the command line can say.

    Attributes
    ----------
    duration_s : float or None
        Stream seconds after which to stop.
    record : Path or None
        Write the frames into this recording as well.
    stdout_is_terminal : bool
        Whether a person reads stdout.
    """

    duration_s: float | None = None
    record: Path | None = None
    stdout_is_terminal: bool = False


def run(config: Config, options: RunOptions) -> int:
    """Run the daemon.

    Parameters
    ----------
    config : Config
        What holds.
    options : RunOptions
        The rest.

    Returns
    -------
    int
        Exit code.

    Raises
    ------
    RadardError, X2RadarError
        With the exit code that the command ends with. Nothing was written when the fault
        is in what was asked for.
    """
    port = config.sensor.port
    if port is None:
        msg = "no port: give --port /dev/ttyACM0, sim:SCENE or replay:FILE"
        raise UsageError(msg)
    name = config.model.name
    classifier = None if name == "none" else Classifier(load_bundle(name))
    return _Run(config, options, port, classifier).go()


class _Run:
    def __init__(
        self, config: Config, options: RunOptions, port: str, classifier: Classifier | None
    ) -> None:
        self._config = config
        self._options = options
        self._port = port
        self._ring: FrameRing | None = None
        self._early: list[tuple[str, str]] = []
        self._failure: BaseException | None = None
        self._stopped = threading.Event()
        self._source = open_source(
            port,
            speed=config.sensor.speed,
            wait=config.sensor.wait,
            quit_on_loss=config.sensor.on_device_loss == "quit",
            on_notice=self._on_notice,
        )
        try:
            self._pipeline = Pipeline(self._source.stream, config, classifier)
            self._ring = self._pipeline.make_ring()
        except BaseException:
            self._source.close()
            raise
        self._health = Health()
        self._events = EventTracker()
        self._sinks: list[Sink] = []

    def go(self) -> int:
        assert self._ring is not None  # noqa: S101 - set at construction
        warning = getattr(self._source, "warning", None)
        if warning:
            log.warning("%s", warning)
        try:
            with _Tap(self._options.record, self._source) as tap:
                self._sinks = open_sinks(
                    self._config.output, stdout_is_terminal=self._options.stdout_is_terminal
                )
                reader = threading.Thread(
                    target=self._read, args=(self._ring, tap), name="reader", daemon=True
                )
                with _signals(self._stop):
                    self._emit(hello_record(self._pipeline, self._port, self._config.sensor.name))
                    self._status(self._health.status)
                    reader.start()
                    self._work(self._ring)
                    self._stop()
                    reader.join(_JOIN_S)
        finally:
            self._stop()
            for sink in self._sinks:
                sink.close()
        if self._failure is not None:
            raise self._failure
        return 0

    def _work(self, ring: FrameRing) -> None:
        while not self._stopped.is_set():
            try:
                # Short enough for a signal to be handled where waits cannot be interrupted.
                item = ring.take(0.5)
            except TimeoutError:
                continue
            if item is None:
                break
            if isinstance(item, Notice):
                self._take_notice(item)
            else:
                self._take_dwell(item)
        self._status(self._health.on_end(self._why_ended()))

    def _why_ended(self) -> str:
        if self._failure is not None:
            return " ".join(str(self._failure).split())
        return "stopped" if self._stopped.is_set() else "end of stream"

    def _take_dwell(self, dwell: Dwell) -> None:
        decision = self._pipeline.decide(dwell)
        self._status(self._health.on_decision(decision))
        self._emit(decision_record(decision))
        for event in self._events.on_decision(decision, dwell):
            self._emit(event_record(event))

    def _take_notice(self, notice: Notice) -> None:
        if notice.kind == "restart":
            self._pipeline.restart()
        log.warning("%s: %s", notice.kind, notice.reason)
        self._status(self._health.on_notice(notice))
        for event in self._events.on_notice(notice):
            self._emit(event_record(event))

    def _read(self, ring: FrameRing, tap: "_Tap") -> None:
        rate_hz = self._source.stream.frame_rate_hz
        most = None
        if self._options.duration_s is not None:
            most = max(1, round(self._options.duration_s * rate_hz))
        first = None
        try:
            for frame in self._source.frames():
                first = frame.index if first is None else first
                if most is not None and frame.index - first >= most:
                    break
                tap.write(frame)
                if not ring.push(frame):
                    break
        except BaseException as err:  # noqa: BLE001 - handed over to the main thread
            self._failure = err
        finally:
            ring.end()

    def _on_notice(self, kind: str, reason: str) -> None:
        if self._ring is None:
            log.warning("%s: %s", kind, reason)
        else:
            self._ring.post(kind, reason)

    def _stop(self) -> None:
        self._stopped.set()
        if self._ring is not None:
            self._ring.end()
            self._ring.stop()
        self._source.close()

    def _emit(self, record: Record) -> None:
        for sink in self._sinks:
            sink.write(record)

    def _status(self, status: Status | None) -> None:
        if status is not None:
            log.info("%s %s", status.state, status.reason)
            self._emit(status_record(status))


class _Tap:
    """A recording that is made along the way, or nothing."""

    def __init__(self, path: Path | None, source: FrameSource) -> None:
        self._close: Callable[[], None] = lambda: None
        self.write: Callable[[Frame], None] = lambda _frame: None
        if path is None:
            return
        # Late: a run that records nothing must not wait for h5py at start.
        from x2radar.recording import RecordingWriter  # noqa: PLC0415

        stream = source.stream
        writer = RecordingWriter(
            path, stream, started_utc=utc_now(), device={"name": stream.device}, settings={}
        )
        self.write, self._close = writer.write, writer.close

    def __enter__(self) -> "_Tap":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()


@contextmanager
def _signals(stop: Callable[[], None]) -> Iterator[None]:
    """Stop on SIGINT and SIGTERM; a second one kills, because the first takes the handler off."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    watched = (signal.SIGINT, signal.SIGTERM)

    def handle(_number: int, _frame: object) -> None:
        for number in watched:
            signal.signal(number, signal.SIG_DFL)
        stop()

    before = {number: signal.signal(number, handle) for number in watched}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
