"""Write HDF5 recordings so that a kill at any moment leaves a readable file.

The file is made under a temporary name, switched to SWMR mode and given its first frame before it
gets its own name; from then on every whole chunk, a second of frames, goes to the disk at once. So
a file of that name is readable from the first moment, and a kill costs less than one second.
"""

import contextlib
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from x2radar.atomic import sync_path
from x2radar.errors import RecordingError, WriteError
from x2radar.frame import Closing, Frame, StreamInfo
from x2radar.recording.about import SAMPLE_DTYPES, root_attributes
from x2radar.recording.blocks import Block, Label
from x2radar.recording.faults import refuse, refuse_taken
from x2radar.wall_clock import utc_text


class RecordingWriter(Closing):
    """Write frames into a new recording; an existing file is never overwritten.

    The file appears with the first frame; `started_utc` is that frame's wall clock, ISO 8601, now
    by default. `device` and `settings` are kept as JSON, `attributes` beside them; `first_index`
    is the `Frame.index` that gets t_s = 0. `fsync` waits for the disk after every chunk, so that a
    power failure costs no more than a kill: some milliseconds on an SSD, up to a second on an SD
    card. Raises RecordingError if the file exists or cannot be made.
    """

    def __init__(
        self,
        path: Path | str,
        stream: StreamInfo,
        *,
        started_utc: str | None = None,
        device: Mapping[str, Any] | None = None,
        settings: Mapping[str, Any] | None = None,
        first_index: int = 0,
        attributes: Mapping[str, Any] | None = None,
        fsync: bool = False,
    ) -> None:
        self._path = path = Path(path)
        self._rate_hz = stream.frame_rate_hz
        self._first_index = first_index
        self._fsync = fsync
        self.n_frames = 0
        self._made_as = path.with_name(f".{path.name}.{os.getpid()}.new")
        refuse_taken(path)
        try:
            self._file = h5py.File(self._made_as, "x", libver="latest")
        except OSError as err:
            raise self._cannot_make(err) from err
        started_utc = utc_text() if started_utc is None else started_utc
        about = root_attributes(stream, started_utc, device or {}, settings or {})
        self._published = False
        try:
            with _given_up(path, self._file):
                self._begin(stream, {**about, **(attributes or {})})
        except WriteError:
            self._drop()
            raise

    def _begin(self, stream: StreamInfo, attributes: Mapping[str, Any]) -> None:
        self._file.attrs.update(attributes)
        n = max(1, round(stream.frame_rate_hz))
        self._buffers: tuple[NDArray[Any], ...] = (
            np.empty((n, stream.axis.n_range), SAMPLE_DTYPES[stream.axis.kind]),
            np.empty(n, np.uint32),
            np.empty(n, np.float64),
        )
        self._filled = self._flushed = 0
        group = self._file.create_group("frames")
        self._sets = [
            group.create_dataset(
                name,
                shape=(0, *buffer.shape[1:]),
                maxshape=(None, *buffer.shape[1:]),
                chunks=buffer.shape,
                dtype=buffer.dtype,
                shuffle=True,
                compression="gzip",
                compression_opts=1,
            )
            for name, buffer in zip(("samples", "counter", "t_s"), self._buffers, strict=True)
        ]
        self._file.flush()
        self._file.swmr_mode = True

    def write(self, frame: Frame) -> None:
        """Keep one frame; a second's worth goes to the disk at once.

        Raises RecordingError if the disk does not take it, or its length is not the stream's.
        """
        if not self._file:
            raise refuse(self._path, "the recording is closed")
        if frame.samples.shape != self._buffers[0].shape[1:]:
            raise refuse(
                self._path, f"a frame of {frame.samples.size} bins does not fit the recording"
            )
        t_s = (frame.index - self._first_index) / self._rate_hz
        counter = np.array([frame.counter], np.uint32)
        self.write_block(Block(frame.samples[None], counter, np.array([t_s])))
        if not self._published:
            self._flush()

    def write_block(self, block: Block) -> None:
        """Keep many frames, with the times that the block gives; see `write`."""
        at, n_chunk = 0, len(self._buffers[0])
        while at < len(block.counter):
            k = self._filled
            n = min(n_chunk - k, len(block.counter) - at)
            given = (block.samples, block.counter, block.t_s)
            for buffer, values in zip(self._buffers, given, strict=True):
                buffer[k : k + n] = values[at : at + n]
            self._filled = k + n
            self.n_frames += n
            at += n
            if self._filled == n_chunk:
                self._flush()

    def close(self) -> None:
        """Write what is left and close the file; a second call does nothing.

        A file without frames is taken away again.
        """
        if not self._file:
            return
        try:
            if self._filled > self._flushed:
                self._flush()
            # What fails here can be given up; what fails at the close crashes the process.
            with _given_up(self._path, self._file):
                self._file.flush()
        finally:
            self._drop()
            if self._published and self._fsync:
                with contextlib.suppress(OSError):
                    sync_path(self._path)

    def _drop(self) -> None:
        with contextlib.suppress(OSError, RuntimeError):
            self._file.close()
        self._made_as.unlink(missing_ok=True)

    def _flush(self) -> None:
        first, last = self._flushed, self._filled
        self._flushed = last
        if last == len(self._buffers[0]):
            self._filled = self._flushed = 0
        with _given_up(self._path, self._file):
            for dataset, buffer in zip(self._sets, self._buffers, strict=True):
                old = len(dataset)
                dataset.resize(old + last - first, axis=0)
                dataset[old:] = buffer[first:last]
                dataset.flush()
                # Counters and times that are on the disk vouch for their samples.
                if self._fsync and dataset is not self._sets[1]:
                    os.fsync(self._file.id.get_vfd_handle())
        if not self._published:
            self._publish()

    def _publish(self) -> None:
        """Give the file its name, unless another program has taken it meanwhile."""
        try:
            try:
                os.link(self._made_as, self._path)
                self._made_as.unlink()
            except OSError:
                # The name is taken, or there are no hard links on this file system.
                if self._path.exists():
                    raise
                self._made_as.rename(self._path)
            if self._fsync:
                with contextlib.suppress(OSError):
                    sync_path(self._path.parent)
        except OSError as err:
            raise self._cannot_make(err) from err
        self._published = True

    def _cannot_make(self, err: OSError) -> RecordingError:
        why = "exists already" if self._path.exists() else reason(err)
        return refuse(self._path, f"cannot make a recording there: {why}")


@contextlib.contextmanager
def _given_up(path: Path, file: h5py.File) -> Iterator[None]:
    """Raise WriteError for a failed write; HDF5 gets /dev/null, as it tries again and crashes."""
    try:
        yield
    except (OSError, RuntimeError) as err:
        with contextlib.suppress(OSError, RuntimeError):
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.dup2(nowhere, file.id.get_vfd_handle())
            os.close(nowhere)
        raise WriteError.of(path, reason(err)) from err


def write_labels(path: Path, labels: list[Label]) -> None:
    """Add labelled stretches to a recording that is not being written any more; or WriteError."""
    if not labels:
        return
    try:
        # A reader's lock must not keep out what belongs into it; there is one writer.
        file = h5py.File(path, "r+", libver="latest", locking=False)
    except OSError as err:
        raise WriteError.of(path, reason(err)) from err
    try:
        with _given_up(path, file):
            group = file.create_group("labels")
            columns = zip(*labels, strict=True)
            # Held until they are on the disk: one that is let go before writes what it has.
            held = [
                group.create_dataset(name, data=list(values))
                for name, values in zip(("t0_s", "t1_s", "label"), columns, strict=True)
            ]
            file.flush()
            held.clear()
    finally:
        with contextlib.suppress(OSError, RuntimeError):
            file.close()


def reason(err: BaseException) -> str:
    """Return the part of an HDF5 error that a person can use."""
    text = " ".join(str(err).split())
    _, _, behind = text.partition("error message = '")
    return behind.partition("'")[0] or text.partition("(")[2].rstrip(")") or text
