"""Maps that grow with slow time: frames in, columns out, the last of them kept."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radard.dsp.gram import Reals
from radard.dsp.steps import Flags, StepBuffer, blocks
from radard.errors import FeatureError

Values = NDArray[Any]


class ColumnStore:
    """The last `n_keep` columns of a map, each with a flag, contiguous, oldest first."""

    def __init__(self, n_keep: int) -> None:
        self.n_keep = n_keep
        self.restart()

    def restart(self) -> None:
        """Drop all columns; the next ones follow no gap."""
        self._columns: Values = np.zeros((0, 0))
        self._flags = np.zeros(0, np.bool_)

    def __len__(self) -> int:
        return len(self._flags)

    def append(self, columns: Values, flags: Flags) -> None:
        """Add columns, shape (n, ...); further axes and type are those of the first ones."""
        kept = self._columns if len(self) else columns[:0]
        self._columns = np.concatenate([kept, columns])[-self.n_keep :]
        self._flags = np.concatenate([self._flags, flags])[-self.n_keep :]

    def last(self, n: int | None) -> tuple[Values, Flags]:
        """Return the last `n` columns and flags, views; raise FeatureError if there are fewer."""
        n = len(self) if n is None else n
        if not 0 <= n <= len(self):
            msg = f"{n} columns wanted, {len(self)} are there (at most {self.n_keep} are kept)"
            raise FeatureError(msg)
        part = slice(len(self) - n, len(self))
        return self._columns[part], self._flags[part]


class ColumnStream(ABC):
    """A map whose columns need `n_history` earlier steps; `n_keep` of `n_rows` rows are kept."""

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

    def restart(self) -> None:
        """Forget everything, as after a gap: the next column comes after a whole CPI."""
        self._alone = None
        self._store.restart()

    def push(self, frames: ArrayLike, valid: ArrayLike | None = None) -> int:
        """Add a frame or many, (n, n_range) or (n_range,), see `blocks`; return the columns made.

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
        self._steps = StepBuffer(max(stream.n_history for stream in streams))

    def restart(self) -> None:
        """Restart all maps."""
        self._steps.restart()
        for stream in self._streams:
            stream.restart()

    def push(self, frames: ArrayLike, valid: ArrayLike | None = None) -> int:
        """Add frames to all maps, see `ColumnStream.push`; return the columns of the last one."""
        made = 0
        for part, flags in blocks(frames, valid, self._n_block):
            self._steps.push(part, flags)
            made += [stream.advance(self._steps, len(part)) for stream in self._streams][-1]
        return made
