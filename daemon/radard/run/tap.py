"""Tap: a recording that is made along the way (--record), or nothing.

It ends before the alarm does: a disk that is full, or too slow, ends the recording, which health
says, and the frames go on to the ring. A thread of its own writes.
"""

import contextlib
import errno
import logging
import queue
import shutil
import threading
from collections.abc import Callable
from pathlib import Path

from radard.log_file import is_passing
from x2radar.errors import RecordingError
from x2radar.frame import Frame, StreamInfo
from x2radar.wall_clock import utc_text

log = logging.getLogger("radard")
_MAX_WAITING_S = 10.0  # of frames: longer than a disk pauses to tidy itself up


class Tap:
    """Write a stream's frames into a new recording, if there is a path; `complain` hears of it."""

    def __init__(
        self,
        path: Path | None,
        stream: StreamInfo,
        *,
        free_bytes: float = 0.0,
        complain: Callable[[str], object] = lambda _reason: None,
        waits: bool = False,
    ) -> None:
        self._complain = complain
        self._waits = waits
        self._thread: threading.Thread | None = None
        self._free_bytes = free_bytes
        self._n_check = max(1, round(stream.frame_rate_hz))
        if path is None:
            return
        # Late: a run that records nothing must not wait for h5py at start.
        from x2radar.recording.hdf5_writer import RecordingWriter  # noqa: PLC0415

        self._path = new_name(path)
        if self._path != path:
            log.warning("%s is there already; recording into %s", path, self._path)
        try:
            self._check_space()
            self._writer = RecordingWriter(
                self._path, stream, started_utc=utc_text(), device={"name": stream.device}
            )
        except RecordingError as err:
            if not is_passing(err.__cause__):
                raise
            self._give_up(str(err))
            return
        n_waiting = round(_MAX_WAITING_S * stream.frame_rate_hz)
        self._frames: queue.Queue[Frame | None] = queue.Queue(n_waiting)
        self._thread = threading.Thread(target=self._write_all, name="recording", daemon=True)
        self._thread.start()

    def write(self, frame: Frame) -> None:
        """Keep a frame; returns at once unless the stream can wait."""
        if self._thread is None:
            return
        try:
            self._frames.put(frame, block=self._waits)
        except queue.Full:
            self._thread = None
            self._give_up(f"{self._path}: the disk is too slow, or hangs")

    def close(self, timeout_s: float = 1.5) -> bool:
        """Write what is left and close the recording; return whether that is done."""
        thread, self._thread = self._thread, None
        if thread is None:
            return True
        self._frames.put(None)
        thread.join(None if self._waits else timeout_s)
        return not thread.is_alive()

    def _write_all(self) -> None:
        frames = iter(self._frames.get, None)
        try:
            for n, frame in enumerate(frames):
                if n % self._n_check == 0:
                    self._check_space()
                self._writer.write(frame)
            self._writer.close()
        except (RecordingError, OSError) as err:
            self._give_up(str(err))
            for _ in frames:
                pass  # a stream that waits for room goes on
            with contextlib.suppress(RecordingError, OSError):
                self._writer.close()

    def _check_space(self) -> None:
        try:
            free_bytes = shutil.disk_usage(self._path.parent).free
        except OSError:
            # The writer knows better what is wrong.
            return
        if free_bytes < self._free_bytes:
            msg = f"{self._path}: only {free_bytes / 1e6:.0f} MB are left on the disk"
            raise RecordingError(msg) from OSError(errno.ENOSPC, msg)

    def _give_up(self, why: str) -> None:
        reason = f"ended: {why}; the alarm goes on without"
        log.warning("recording %s", reason)
        self._complain(reason)


def new_name(path: Path) -> Path:
    """Return a name that no file has: `run.h5`, else `run-2.h5` and so on."""
    found, n = path, 1
    while found.exists():
        n += 1
        found = path.with_name(f"{path.stem}-{n}{path.suffix}")
    return found
