"""Service: runs one radar until its stream or the user ends it.

Threads: the *reader* takes frames from the source, converts them and pushes them into the
ring; the *worker* (`radard.worker`) takes dwells, decides, and writes to the outputs; the
*heart* (`radard.heart`) shows that all this lives; *clips* writes evidence. The main thread
opens, supervises and closes: it never waits for a disk, a port or a reader of stdout while
the others run, so signals are always heard.
"""

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from radard.config import Config
from radard.directories import runtime_dir
from radard.errors import RadardError, UsageError
from radard.health import STALE_S, Health
from radard.heart import Heart
from radard.output import hello_record, status_record
from radard.outputs import Host, Outputs
from radard.pipeline import Pipeline
from radard.playback import Playback
from radard.quiet import Now, recorded_clock, wall_clock
from radard.ring import FrameRing, Notice
from radard.setup import Parts, make_classifier, make_parts, make_store, remake_parts
from radard.signals import Signals
from radard.source import FrameSource, open_source, parse_speed
from radard.status_file import status_path
from radard.stuck import force_after, state_dump
from radard.tap import Tap
from radard.watchdog import Notifier
from radard.worker import Worker

log = logging.getLogger("radard")
Reload = Callable[[], Config]
_BEAT_S = 1.0
_JOIN_S = 1.5
_DEADLINE_S = 4.5


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
    reload : callable or None
        Reads the configuration again, as at the start.
    """

    duration_s: float | None = None
    record: Path | None = None
    stdout_is_terminal: bool = False
    reload: Reload | None = None


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
    if config.sensor.port is None:
        msg = "no port: give --port /dev/ttyACM0, sim:SCENE or replay:FILE"
        raise UsageError(msg)
    return _Run(config, options, config.sensor.port).go()


class _Run:
    def __init__(self, config: Config, options: RunOptions, port: str) -> None:
        self._config = config
        self._options = options
        self._port = port
        self._classifier = make_classifier(config)
        factor = parse_speed(config.sensor.speed, replay=port.startswith("replay:"))
        self._is_as_fast_as_it_goes = factor is None
        self._health = Health(stale_s=STALE_S * max(1.0, 1.0 / (factor or 1.0)))
        self.signals = Signals()
        self._notifier = Notifier()
        self._worker: Worker | None = None
        self._ring: FrameRing | None = None
        self._playback: Playback | None = None
        self._failure: BaseException | None = None
        self._now: Now = wall_clock
        self._is_live = True
        self._force: threading.Timer | None = None
        self._is_stuck = False
        host = Host(
            self._health,
            self.panel,
            self.command,
            config=lambda: self._worker.parts.config if self._worker else config,
            ring=lambda: self._ring,
            playback=lambda: self._playback,
        )
        self._outputs = Outputs(host, stdout_is_terminal=options.stdout_is_terminal)
        path = status_path(runtime_dir(config), config.sensor.name)
        self._heart = Heart(self._health, self._notifier, path, self.panel)

    def go(self) -> int:
        with self.signals:
            source = self._open()
            why = "ended by a fault at the start"
            try:
                pipeline = Pipeline(source.stream, self._config, self._classifier)
                with Tap(self._options.record, source) as tap:
                    can_wait = not source.is_live or self._is_as_fast_as_it_goes
                    self._outputs.open(self._config, can_wait=can_wait)
                    why = self._run(source, pipeline, tap)
            finally:
                source.close()
                self._health.on_end(why)
                self._heart.stop()
                self._outputs.close()
                # Not with a thread stuck in stdout: the interpreter's own end would hang there.
                if self._force is not None and not self._is_stuck:
                    self._force.cancel()
        if self._failure is not None:
            raise self._failure
        return 0

    def _open(self) -> FrameSource:
        """Open the port, which may mean to wait for a device; the heart beats meanwhile."""
        sensor = self._config.sensor
        try:
            source = open_source(
                self._port,
                speed=sensor.speed,
                wait=sensor.wait,
                quit_on_loss=sensor.on_device_loss == "quit",
                on_notice=self._on_notice,
            )
        except BaseException as err:
            self._health.on_end(" ".join(str(err).split()) or "stopped")
            if self._outputs.is_open:
                self._heart.stop()
                self._outputs.close()
            raise
        self.signals.opened()
        return source

    def _on_notice(self, kind: str, reason: str) -> None:
        if self._ring is not None:
            self._ring.post(kind, reason)
            return
        # Before there is a stream: outputs that show the state do so, the others stay silent.
        log.warning("%s: %s", kind, reason)
        self._health.on_notice(Notice(kind, reason, 0.0))
        if not self._outputs.is_open:
            self._outputs.open(self._config)
            self._heart.start()

    def _run(self, source: FrameSource, pipeline: Pipeline, tap: Tap) -> str:
        """Run the threads until the end; return why it ended."""
        self._is_live = is_live = source.is_live
        self._playback = getattr(source, "playback", None)
        if not is_live:
            self._now = recorded_clock(getattr(source, "started_utc", ""))
        ring = pipeline.make_ring()
        parts = make_parts(self._config, pipeline, now=self._now, is_live=is_live)
        store = make_store(self._config, is_live=is_live)
        worker = Worker(parts, ring, self._outputs, self._health, store)
        self._worker, self._ring = worker, ring
        warning = getattr(source, "warning", None)
        if warning:
            log.warning("%s", warning)
        is_armed = worker.tracker.panel.is_armed
        self._outputs.put(hello_record(pipeline, self._config, is_armed=is_armed))
        self._outputs.put(status_record(self._health.status))
        self._heart.main_is_alive()
        self._heart.start()
        threads = [
            threading.Thread(target=self._read, args=(source, ring, tap, worker), name="reader"),
            threading.Thread(target=self._work, args=(worker,), name="worker"),
        ]
        for thread in threads:
            thread.daemon = True
            thread.start()
        is_stopped = self._supervise(threads[1])
        if is_stopped:
            self._force = force_after(_DEADLINE_S)
        worker.stop()
        ring.end()
        ring.stop()
        source.close()
        for thread in reversed(threads):
            thread.join(_JOIN_S)
        return self._ended(worker, threads, is_stopped=is_stopped)

    def _supervise(self, work: threading.Thread) -> bool:
        """Heed signals until the work is done; return whether one asked for the end."""
        while work.is_alive():
            self._heart.main_is_alive()
            self.signals.wake.wait(_BEAT_S)
            self.signals.wake.clear()
            if self.signals.take("stop"):
                return True
            if self.signals.take("reload"):
                self._reload()
            if self.signals.take("dump"):
                log.warning("state %s", state_dump(self._health, self.panel()))
        return False

    def _ended(self, worker: Worker, threads: list[threading.Thread], *, is_stopped: bool) -> str:
        self._failure = worker.failure or self._failure
        stuck = [thread.name for thread in threads if thread.is_alive()]
        self._is_stuck = bool(stuck)
        if stuck and self._failure is None:
            self._failure = RadardError(f"stuck and left behind: {', '.join(stuck)}")
        why = "stopped" if is_stopped else "end of stream"
        if self._failure is not None:
            why = " ".join(str(self._failure).split())
        clips = worker.parts.clips
        if clips is not None and not clips.close(_JOIN_S):
            log.warning("the last clip may lack its end: the disk is too slow")
        self._health.on_end(why)
        if not isinstance(self._failure, BrokenPipeError):
            self._outputs.put(status_record(self._health.status))
        return why

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
        except BaseException as err:  # noqa: BLE001 - handed over to the main thread
            self._failure = err
        finally:
            ring.end()

    def _work(self, worker: Worker) -> None:
        worker.run()
        self.signals.wake.set()

    def _reload(self) -> None:
        """Read the configuration again and hand it to the worker; the stream goes on."""
        if self._options.reload is None or self._worker is None:
            return
        self._notifier.reloading()
        worker = self._worker
        try:
            parts = remake_parts(
                self._options.reload(), worker.parts, now=self._now, is_live=self._is_live
            )
        except RadardError as err:
            log.warning("reload: the old configuration stays: %s", err)
        else:
            worker.exchange(parts)
            is_armed = worker.tracker.panel.is_armed
            hello = hello_record(parts.pipeline, parts.config, is_armed=is_armed)
            self._outputs.reload(parts.config, hello)
            log.info("reload: done")
        self._notifier.ready(self._health.status.state)

    @property
    def parts(self) -> Parts:
        """What the worker works with; there is none before the port is open."""
        assert self._worker is not None  # noqa: S101 - as said
        return self._worker.parts

    def panel(self) -> dict[str, object]:
        return dict(self._worker.panel()) if self._worker is not None else {}

    def command(self, name: str) -> None:
        if self._worker is not None:
            self._worker.command(name)
