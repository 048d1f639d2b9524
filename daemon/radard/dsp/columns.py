"""Maps that grow with slow time: frames in, steps between them, columns out, the last ones kept.

In steps from frame to frame static clutter is gone exactly: numbers within a factor of two of each
other have an exact difference (Sterbenz 1974). A frame that is lost repeats the one before it: its
step is zero, the next good one's spans the gap, and a flag says which those are.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from radard.errors import FeatureError

LARGEST = np.float32(1e38)  # frames with a part beyond: steps would leave float32
_IN_CACHE = 1 << 15  # complex numbers that are worked on at a time: 256 KiB

Frames = NDArray[np.generic]
Flags = NDArray[np.bool_]
Reals = NDArray[np.float64]
Values = NDArray[Any]


def blocks(
    frames: ArrayLike, valid: ArrayLike | None, size: int
) -> Iterator[tuple[Frames, Flags]]:
    """Yield a frame or many, cut into blocks of at most `size` with their flags, as views.

    Frames have the shape (n_slow, n_range) or (n_range,), any numbers; all are good without
    `valid`, shape (n_slow,). Raises FeatureError if shapes or types do not fit.
    """
    rows = np.atleast_2d(np.asarray(frames))
    if rows.ndim != 2 or rows.shape[1] == 0 or rows.dtype.kind not in "iufc":
        msg = f"frames of shape {np.shape(frames)} and type {rows.dtype} are no record of frames"
        raise FeatureError(msg)
    good = np.ones(len(rows), np.bool_) if valid is None else valid
    flags = np.atleast_1d(np.asarray(good, np.bool_))
    if flags.shape != rows.shape[:1]:
        raise FeatureError(f"{rows.shape[0]} frames, but {flags.size} flags")
    for first in range(0, len(rows), size):
        part = slice(first, first + size)
        yield rows[part], flags[part]


def whole(valid: Flags, n_cpi: int, stride: int = 1) -> Flags:
    """Return which CPIs, `stride` apart, hold good frames only, bool, from `valid` (n_slow,)."""
    n_lost = np.concatenate(([0], np.cumsum(~valid)))
    return np.asarray((n_lost[n_cpi:] == n_lost[:-n_cpi])[::stride])


class Tail:
    """The last `n_keep` rows of what grows, each with a flag, contiguous, oldest first.

    They move to the front of a buffer when it is full, for which at most `n_most` come at once.
    """

    def __init__(self, n_keep: int, n_most: int) -> None:
        self.n_keep = n_keep
        self._rows: Values = np.zeros((n_keep + n_most, 0))
        self._flags = np.zeros(n_keep + n_most, np.bool_)
        self.fill = 0  # rows that are there; `n_keep` of them will stay

    def grow(self, n: int, shape: tuple[int, ...], dtype: DTypeLike) -> tuple[Values, Flags]:
        """Return `n` new rows and flags to write, as views; the first ones set shape and type."""
        if self._rows.shape[1:] != shape:
            self._rows, self.fill = np.zeros((len(self._flags), *shape), dtype), 0
        if self.fill + n > len(self._flags):
            kept = slice(self.fill - self.n_keep, self.fill)
            self._rows[: self.n_keep] = self._rows[kept]
            self._flags[: self.n_keep] = self._flags[kept]
            self.fill = self.n_keep
        self.fill += n
        return self.last(n)

    def last(self, n: int) -> tuple[Values, Flags]:
        """Return the last `n` rows and flags, views."""
        part = slice(self.fill - n, self.fill)
        return self._rows[part], self._flags[part]


class StepBuffer:
    """The last `n_keep` steps of one stream: all real parts of a row, then all imaginary ones."""

    def __init__(self, n_keep: int, n_block: int) -> None:
        self.n_range = 0
        self._tail = Tail(n_keep, n_block)
        self._n_block = n_block
        self._scratch = np.zeros((0, 0), np.complex64)
        self._last: Frames | None = None
        self._product: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
        self.n_frames = 0

    def push(self, frames: Frames, valid: Flags) -> None:
        """Add frames and flags from `blocks`; those that are not finite count as lost unnamed."""
        n, n_range = frames.shape
        if self.n_frames == 0 and n_range != self.n_range:
            self.n_range = n_range
            n_scratch = min(self._n_block, max(1, _IN_CACHE // n_range))
            self._scratch = np.zeros((n_scratch, n_range), np.complex64)
        if n_range != self.n_range:
            raise FeatureError(f"a frame of {n_range} bins in a stream of {self.n_range}")
        self._product = None
        rows, flags = self._tail.grow(n, (2 * n_range,), np.float32)
        flags[:] = valid
        # A first frame has no step that would show what is wrong with it.
        looks_good = self._last is not None or _usable(frames[:1]).all()
        if not flags.all() or not looks_good or not self._write(frames, rows):
            frames = self._repaired(frames, flags)
            self._write(frames, rows)
        if flags.any():
            self._last = frames[-1].astype(np.result_type(frames.dtype, np.complex64))
        self.n_frames += n

    def rows(self, n: int) -> NDArray[np.float32]:
        """Return the last `n` steps, shape (n, 2 n_range), float32, a view."""
        return self._tail.last(n)[0]

    def product(self, matrix: NDArray[np.float32], n: int) -> NDArray[np.float32]:
        """Return the last `n` steps times a matrix, (n, columns), float32; kept for maps alike."""
        if self._product is None or self._product[0] is not matrix or len(self._product[1]) != n:
            self._product = matrix, self.rows(n) @ matrix
        return self._product[1]

    def flags(self, n: int) -> Flags:
        """Return which of the last `n` frames are good, shape (n,), bool, a view."""
        return self._tail.last(n)[1]

    def _write(self, frames: Frames, rows: NDArray[np.float32]) -> bool:
        """Write the steps that lead to `frames`; return False if one is not finite."""
        n, n_range = frames.shape
        # The wider of input and complex64: a step is rounded once, after the subtraction.
        work = np.result_type(frames.dtype, np.complex64)
        last = frames[0] if self._last is None else self._last
        size = len(self._scratch)
        with np.errstate(over="ignore", invalid="ignore"):
            for first in range(0, n, size):
                part = frames[first : first + size]
                steps = self._scratch[: len(part)]
                np.subtract(part[0], last, out=steps[0], dtype=work, casting="same_kind")
                np.subtract(part[1:], part[:-1], out=steps[1:], dtype=work, casting="same_kind")
                rows[first : first + size, :n_range] = steps.real
                rows[first : first + size, n_range:] = steps.imag
                last = part[-1]
        flat = rows.reshape(-1)
        # One dot product finds what is not finite; strong frames, which overflow it, do not count.
        return bool(np.isfinite(np.vdot(flat, flat)) or _usable(frames).all())

    def _repaired(self, frames: Frames, flags: Flags) -> Frames:
        """Return the frames with the one before in place of every bad one; clear its flag."""
        flags &= _usable(frames)
        source = np.maximum.accumulate(np.where(flags, np.arange(len(frames)), -1))
        good = np.asarray(frames[np.maximum(source, 0)], np.result_type(frames, np.complex64))
        if source[0] < 0:
            before = self._last
            if before is None:
                # Nothing good yet: stand still at the first good frame, or at zero.
                first = int(flags.argmax())
                before = good[first] if flags[first] else np.zeros_like(good[0])
            good[source < 0] = before
        return good


def _usable(frames: Frames) -> Flags:
    parts = np.stack([frames.real, frames.imag])
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(parts) < LARGEST).all(axis=(0, 2)))


class ColumnStore(Tail):
    """Columns of a map, of which never more than the last `n_keep` can be asked for."""

    def __init__(self, n_keep: int) -> None:
        super().__init__(n_keep, n_keep)

    def __len__(self) -> int:
        return min(self.fill, self.n_keep)

    def append(self, columns: Values, flags: Flags) -> None:
        """Add columns, shape (n, ...); further axes and type are those of the first ones."""
        columns, flags = columns[-self.n_keep :], flags[-self.n_keep :]
        kept, kept_flags = self.grow(len(columns), columns.shape[1:], columns.dtype)
        kept[:], kept_flags[:] = columns, flags

    def last(self, n: int | None) -> tuple[Values, Flags]:
        """Return the last `n` columns and flags, views; raise FeatureError if there are fewer."""
        n = len(self) if n is None else n
        if not 0 <= n <= len(self):
            msg = f"{n} columns wanted, {len(self)} are there (at most {self.n_keep} are kept)"
            raise FeatureError(msg)
        return super().last(n)


class ColumnStream(ABC):
    """A map whose columns need `n_history` earlier steps; `n_keep` of `n_rows` rows are kept.

    Relative error (norm) against the definition in float64 (tests/dsp_reference.py): at most 1e-5
    with static clutter of 0 to 140 dB under the motion, at the amplitudes that each map names;
    however pushes are cut, 1e-6. FeatureError if a setting makes no sense.
    """

    def __init__(self, n_history: int, n_block: int, n_keep: int, n_rows: int) -> None:
        self.n_history = n_history
        self.n_block = n_block
        self._n_rows = n_rows
        self._alone: SharedSteps | None = None
        self._store = ColumnStore(n_keep)

    @property
    def n_columns(self) -> int:
        """Columns that can be asked for now."""
        return len(self._store)

    def push(self, frames: ArrayLike, valid: ArrayLike | None = None) -> int:
        """Add a frame or many, see `blocks`; return the columns made.

        What stands in place of a lost frame, False in `valid`, is ignored. Frames with NaN, Inf or
        more than 1e38 count as lost too. Raises FeatureError if the frames do not fit the stream.
        """
        self._alone = self._alone or SharedSteps(self)
        return self._alone.push(frames, valid)

    @abstractmethod
    def advance(self, steps: StepBuffer, n_new: int) -> int:
        """Make and return the columns that the newest `n_new` frames complete."""

    def columns(self, n: int | None = None) -> Reals:
        """Return a copy of the last `n` columns, or all: linear power, (n_rows, n), float64."""
        columns, _ = self._store.last(n)
        return columns.T.copy() if self._store else np.zeros((self._n_rows, 0))

    def columns_valid(self, n: int | None = None) -> Flags:
        """Return which of the last columns hold no lost frame, shape (n,), bool."""
        return self._store.last(n)[1].copy()


class SharedSteps:
    """Several maps of one stream, fed by this `push` and not their own: steps are made once."""

    def __init__(self, *streams: ColumnStream) -> None:
        self._streams = streams
        self._n_block = min(stream.n_block for stream in streams)
        self._steps = StepBuffer(max(stream.n_history for stream in streams), self._n_block)

    def push(self, frames: ArrayLike, valid: ArrayLike | None = None) -> int:
        """Add frames to all maps, see `ColumnStream.push`; return the columns of the last one."""
        made = 0
        for part, flags in blocks(frames, valid, self._n_block):
            self._steps.push(part, flags)
            made += [stream.advance(self._steps, len(part)) for stream in self._streams][-1]
        return made
