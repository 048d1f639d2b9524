"""Range-time power map: where the power of motion is, in metres and seconds."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from radard.dsp.columns import ColumnStream, Flags, Reals, StepBuffer, whole
from radard.dsp.doppler import MAX_ENERGY, MIN_ENERGY, centring
from radard.errors import FeatureError
from x2radar.frame import FastTimeAxis

MIN_COVERAGE = 0.5  # a cell of which less than this was seen is not known
_BLOCK = 64  # frames at once: a hop at 60 Hz


def overlap(sample_edges: Reals, cell_edges: Reals) -> Reals:
    """Return how much of each cell each sample covers, as shares of it, (n_samples, n_cells).

    From ascending edges in one unit, shapes (n_samples + 1,) and (n_cells + 1,).
    """
    low = np.maximum(sample_edges[:-1, None], cell_edges[:-1])
    high = np.minimum(sample_edges[1:, None], cell_edges[1:])
    return np.asarray(np.maximum(high - low, 0) / np.diff(cell_edges))


def time_cells(
    columns: NDArray[np.floating],
    valid: Flags,
    column_rate_hz: float,
    *,
    cell_s: float,
    n_cells: int,
) -> tuple[Reals, Flags]:
    """Average columns of a map over cells of time, the last of which ends with them.

    Of columns, shape (n_rows, n_columns), each of one period, those that are not `valid` do not
    count. `cell_s` need be neither a whole number of columns nor longer than one. Returns the mean
    of the valid columns, shape (n_rows, n_cells), by the time each has in the cell, zero where
    there is none; and whether at least half of each cell is known. Relative error (norm) at most
    1e-12 for powers from 1e-290 to 1e290.
    """
    n = columns.shape[-1]
    sample_edges = np.arange(-n, 1.0) / column_rate_hz
    cell_edges = np.arange(-n_cells, 1.0) * cell_s
    share = overlap(sample_edges, cell_edges) * valid[:, None]
    known = share.sum(axis=0)
    # Columns that do not count must not count as NaN or Inf either.
    power = np.where(valid, columns, 0.0) @ share
    return power / np.where(known > 0, known, 1.0), known >= MIN_COVERAGE - 1e-9


class RangeTimeMap(ColumnStream):
    """Power by range cell and frame of a stream; clutter is the mean of the `n_cpi` frames around.

    Column i is of the same CPI as the spectrogram's. Cells lie at near_m + k cell_m up to far_m,
    whatever the bins; the swath of the axis when these are not given. Power is the mean over the
    cell's bins (by the length each has in it), in sample units squared, corrected for the share of
    the noise that the mean takes along; zero in cells of which the swath holds less than half.
    Amplitudes: 1e-36 to 1e37.
    """

    def __init__(
        self,
        axis: FastTimeAxis,
        n_cpi: int,
        *,
        cell_m: float = 0.1,
        near_m: float | None = None,
        far_m: float | None = None,
        n_keep: int = 512,
    ) -> None:
        begin_m = axis.range_offset_m - axis.bin_length_m / 2
        near = begin_m if near_m is None else near_m
        far = begin_m + axis.bin_length_m * axis.n_range if far_m is None else far_m
        if n_cpi < 2 or not cell_m > 0 or not near < far:
            msg = f"range-time map: CPI of {n_cpi}, cells of {cell_m} m from {near} to {far} m"
            raise FeatureError(msg)
        made = _design(axis, n_cpi, cell_m, near, far)
        self.range_m, self._weights, self._residual = made
        super().__init__(n_cpi, len(self._residual), n_keep, len(self.range_m))
        self._n_cpi = n_cpi

    def advance(self, steps: StepBuffer, n_new: int) -> int:
        """Make the columns that the newest `n_new` frames complete: power by range."""
        n = min(n_new, steps.n_frames - self._n_cpi + 1)
        if n < 1:
            return 0
        good = whole(steps.flags(n + self._n_cpi - 1), self._n_cpi)
        self._store.append(self._powers(steps, n), good)
        return n

    def cells(
        self, frame_rate_hz: float, *, cell_s: float = 0.05, n_cells: int = 40
    ) -> tuple[Reals, Flags]:
        """Return the map of the last `n_cells * cell_s` seconds, as `time_cells` gives it."""
        n = min(len(self._store), int(np.ceil(n_cells * cell_s * frame_rate_hz)) + 1)
        columns, flags = self._store.last(n)
        power = columns.T if self._store else np.zeros((len(self.range_m), 0))
        return time_cells(power, flags, frame_rate_hz, cell_s=cell_s, n_cells=n_cells)

    def _powers(self, steps: StepBuffer, n: int) -> Reals:
        n_steps = n + self._n_cpi - 2
        z = self._residual[:n, :n_steps] @ steps.rows(n_steps)
        with np.errstate(over="ignore"):
            energy = np.vecdot(z, z)
        exponent = np.zeros(n, np.intc)
        if not ((energy > MIN_ENERGY) & (energy < MAX_ENERGY)).all():
            exponent = np.frexp(np.abs(z).max(axis=1))[1]
            np.ldexp(z, -exponent[:, None], out=z)
        np.multiply(z, z, out=z)
        power = (z @ self._weights).astype(np.float64)
        return np.asarray(np.ldexp(power, 2 * exponent[:, None]))


@lru_cache(maxsize=8)
def _design(
    axis: FastTimeAxis, n_cpi: int, cell_m: float, near_m: float, far_m: float
) -> tuple[Reals, NDArray[np.float32], NDArray[np.float32]]:
    """Return cells, what leads to them from squares of parts, and to residues from steps."""
    bins = np.arange(axis.n_range + 1, dtype=np.float64)
    bin_edges = axis.range_offset_m - axis.bin_length_m / 2 + axis.bin_length_m * bins
    n_cells = max(1, int((far_m - near_m) / cell_m + 1e-9))
    edges = near_m + cell_m * np.arange(n_cells + 1, dtype=np.float64)
    share = overlap(bin_edges, edges)
    covered = share.sum(axis=0)
    is_covered = covered >= MIN_COVERAGE - 1e-9
    share *= np.where(is_covered, 1 / np.where(covered > 0, covered, 1), 0)
    share *= n_cpi / (n_cpi - 1)
    # Row i takes the mean of frames i to i + n_cpi - 1 off the frame in their middle.
    n_block = max(_BLOCK, n_cpi)
    residual = np.zeros((n_block, n_block + n_cpi - 2), np.float32)
    middle = centring(n_cpi)[n_cpi // 2]
    for i in range(n_block):
        residual[i, i : i + n_cpi - 1] = middle
    weights = np.concatenate([share, share]).astype(np.float32)
    made = ((edges[:-1] + edges[1:]) / 2, weights, residual)
    for array in made:
        array.flags.writeable = False
    return made
