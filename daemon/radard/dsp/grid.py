"""Onto a physical grid: averages over cells of metres or seconds, whatever the samples."""

import numpy as np
from numpy.typing import NDArray

from radard.dsp.steps import Flags

Reals = NDArray[np.float64]

MIN_COVERAGE = 0.5  # a cell of which less than this was seen is not known: a half


def overlap(sample_edges: Reals, cell_edges: Reals) -> Reals:
    """Return how much of each cell each sample covers, as shares of the cells' widths.

    From ascending edges, shapes (n_samples + 1,) and (n_cells + 1,), in one unit; the result
    has shape (n_samples, n_cells). A cell within the samples has shares that sum to one.
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
