"""The recording loop: frames to a file until told, out of time or out of space.

A signal is taken between two frames, never inside a write, so every end is a clean one.
"""

import shutil
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TextIO

from x2radar.command import StatusLine
from x2radar.errors import ReadTimeout, RecordingError, TransportClosed, X2RadarError
from x2radar.frame import Frame

_SHOW_EVERY_S = 0.5
"""As fast as numbers can be read."""


class FrameWriter(Protocol):
    """What frames are written to."""

    @property
    def n_bytes(self) -> int:
        """Bytes on the disk so far."""
        ...

    def write(self, frame: Frame) -> None:
        """Keep one frame."""
        ...


@dataclass(slots=True)
class Tally:
    """What was recorded."""

    n_frames: int = 0
    n_lost: int = 0
    n_bytes: int = 0
    is_full: bool = False


class RecordingProgress:
    """How a recording goes, as one line on a terminal."""

    def __init__(self, name: str, out: TextIO) -> None:
        self._name = name
        self._line = StatusLine(out)
        self._n_before = 0
        self._shown_s = time.monotonic()

    def show(self, tally: Tally) -> None:
        """Rewrite the line, twice a second at most."""
        now_s = time.monotonic()
        if not self._line.is_on or now_s - self._shown_s < _SHOW_EVERY_S:
            return
        rate_hz = (tally.n_frames - self._n_before) / (now_s - self._shown_s)
        self._shown_s, self._n_before = now_s, tally.n_frames
        self._line.show(
            f"{self._name}: {tally.n_frames} frames, {rate_hz:.1f} Hz, "
            f"{tally.n_lost} lost, {tally.n_bytes / 1e6:.1f} MB"
        )

    def clear(self) -> None:
        """Take the line away."""
        self._line.clear()


def free_bytes(*paths: Path) -> float:
    """Return the least free space where `paths` are made, in bytes; inf when unknown."""
    least = float("inf")
    for path in paths:
        try:
            least = min(least, shutil.disk_usage(path.parent).free)
        except OSError:
            continue
    return least


@contextmanager
def stop_flag() -> Iterator[threading.Event]:
    """Lend an event that the first SIGINT or SIGTERM sets; the second interrupts.

    Outside the main thread nobody sets it.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    watched = (signal.SIGINT, signal.SIGTERM)

    def handle(_number: int, _frame: object) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    before = {number: signal.signal(number, handle) for number in watched}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def record(
    frames: Iterator[Frame],
    writer: FrameWriter,
    *,
    stop: threading.Event,
    most_frames: float,
    check_every: int,
    floor_bytes: float = 0.0,
    paths: tuple[Path, ...] = (),
    progress: RecordingProgress | None = None,
) -> Tally:
    """Write frames until the stream is long enough, `stop` is set or the disk is full.

    `most_frames` counts lost frames, too. Every `check_every` frames the disks of `paths` are
    looked at: `floor_bytes` are to stay free. The caller closes the writer. Raises X2RadarError
    if the disk does not take a frame, ReadTimeout or TransportClosed if the device is lost and
    `stop` is not set.
    """
    tally = Tally()
    try:
        for frame in frames:
            if frame.index >= most_frames:
                break
            try:
                writer.write(frame)
            except RecordingError as err:
                # No bad input, as reading a recording would be: exit code 1.
                raise X2RadarError(str(err)) from err
            tally.n_frames += 1
            tally.n_lost += frame.lost if tally.n_frames > 1 else 0
            if tally.n_frames % check_every == 0:
                tally.n_bytes = writer.n_bytes
                tally.is_full = free_bytes(*paths) < floor_bytes
            if progress is not None:
                progress.show(tally)
            if stop.is_set() or tally.is_full:
                break
    except (ReadTimeout, TransportClosed):
        if not stop.is_set():
            raise
    finally:
        if progress is not None:
            progress.clear()
    return tally
