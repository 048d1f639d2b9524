"""A radar at work: its port is open (`OpenedSensor`), its stream is read (`RunningSensor`).

The *reader*, a thread, takes frames from the source and pushes them into the ring; threads of the
pool take what the ring completes to the worker, one item a turn. A recording needs no reader: its
frames are there, so the pool reads it, too (a disk that hangs holds one of its threads).
"""

import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from radard.errors import RadardError
from radard.pipeline import Pipeline
from radard.run.pool import WorkerPool
from radard.run.tap import Tap
from radard.run.worker import Worker
from radard.stream.source import FrameSource, ReplaySource
from x2radar.frame import Frame

_MAX_REST_S = 1.0  # who opens the page sees the stream go on within it
_JOIN_S = 1.5  # for each thread: all of them within the 4.5 s of a forced end


@dataclass(frozen=True, slots=True)
class OpenedSensor:
    """An open port, and what fits its stream."""

    source: FrameSource
    pipeline: Pipeline
    tap: Tap  # to be closed with the source

    def close(self) -> bool:
        """Let go of port and recording; return whether the latter is whole."""
        self.source.close()
        return self.tap.close()


class RunningSensor:
    """A stream that is read and worked on until it ends."""

    def __init__(
        self, opened: OpenedSensor, worker: Worker, pool: WorkerPool, duration_s: float | None
    ) -> None:
        self.opened, self.worker, self.ring = opened, worker, worker.ring
        self.failure: BaseException | None = None  # what ended the work, but for the stream
        self.over = threading.Event()  # the work has ended
        self.end = threading.Event()  # it has, or was asked to
        self._max_frames = math.inf
        if duration_s is not None:
            self._max_frames = max(1, round(duration_s * self.ring.frame_rate_hz))
        self._is_stopped = False
        self._pool = pool
        self._ask = partial(pool.ask, self._step)
        config = worker.parts.config
        name = f"{config.sensor.name} reader" if config.is_one_of_several else "reader"
        self._reader = threading.Thread(target=self._read, name=name, daemon=True)
        self._first: int | None = None
        self._items: Iterator[Frame | float] | None = None
        self.ring.post("begin", call=lambda _t_s: worker.begin())

    def start(self) -> None:
        """Start the reader; from now on the pool works on what the ring has."""
        self.ring.on_item = self._ask
        if isinstance(source := self.opened.source, ReplaySource):
            self._items = source.items()
            source.playback.on_change = self._ask
            source.playback.begin_s = self._pool.begin_s()
        else:
            self._reader.start()
        self._ask()

    def stop(self) -> None:
        """Ask for the end; for any thread."""
        self._is_stopped = True
        self.ring.end()
        self.ring.stop()
        self.opened.source.close()
        self.end.set()

    def finish(self) -> list[str]:
        """Wait a moment for the end and close what is its own; return what is stuck."""
        stuck = []
        if not self.over.wait(_JOIN_S):
            stuck.append("worker")
            self._pool.grow()
        if self._items is None:
            self._reader.join(_JOIN_S)
            if self._reader.is_alive():
                stuck.append(self._reader.name)
        if stuck and self.failure is None:
            self.failure = RadardError(f"stuck and left behind: {', '.join(stuck)}")
        self.worker.close(_JOIN_S)
        return stuck

    def _read(self) -> None:
        try:
            for frame in self.opened.source.frames():
                if not self._keep(frame) or not self.ring.push(frame):
                    break
        except BaseException as err:  # noqa: BLE001 - handed over to the keeper
            self.failure = self.failure or err
        finally:
            self.ring.end()

    def _keep(self, frame: Frame) -> bool:
        """Keep a frame for recording and clips; return False if it is one too many."""
        self._first = frame.index if self._first is None else self._first
        if frame.index - self._first >= self._max_frames:
            return False
        self.opened.tap.write(frame)
        self.worker.hold(frame)
        return True

    def _read_on(self, items: Iterator[Frame | float]) -> bool:
        """Read what is due, and work on the first item of it; return whether there is more."""
        for found in items:
            if not isinstance(found, Frame):
                # The next dwell is whole so much later than the next frame is due.
                source = self.opened.source
                speed = source.playback.speed if isinstance(source, ReplaySource) else None
                rate_hz = source.stream.frame_rate_hz * (speed or math.inf)
                rest_s = min((self.ring.n_left - 1) / rate_hz, _MAX_REST_S)
                self._pool.ask_in(self._step, found + rest_s)
                return False
            if not self._keep(found):
                break
            has_worked = False
            for item in self.ring.items(found):
                self.worker.handle(item)
                has_worked = True
            if has_worked:
                return True
        self.ring.end()
        return True

    def _step(self) -> bool:
        """Work on one item; return whether there may be another."""
        if self.over.is_set():
            return False
        try:
            has_more = self._work()
        except BaseException as err:  # noqa: BLE001 - handed over to the keeper
            self.failure, has_more = err, None
        if has_more is None:
            self.over.set()
            self.end.set()
        return bool(has_more)

    def _work(self) -> bool | None:
        """Work on one item; return whether there was one, None at the end."""
        if self._is_stopped:
            return None
        try:
            item = self.ring.next_item(0)
        except TimeoutError:
            return self._read_on(self._items) if self._items is not None else False
        if item is None:
            return None
        self.worker.handle(item)
        return True
