"""A dwell in cells of range: still echoes, their unrest, and the receiver's noise, in float64."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.stream.ring import Dwell

CELL_M = 0.3  # a piece of furniture
_PARTS = 4  # of a dwell, for the unrest
_EVERY = 4  # of so many frames one is looked at
_NOISE_FRAMES = 16
_MIN_WHITE, _MAX_WHITE = 0.8, 1.25  # second over first differences
_MAX_SPREAD_DB = 6.0  # of the noise over range


@dataclass(frozen=True, slots=True, eq=False)
class CellReading:
    """What one dwell shows, cell by cell; powers in sample units squared."""

    echoes: NDArray[np.complex128]  # mean over the dwell, shape (n_cells, n_bins)
    energy: NDArray[np.float64]  # sum over a cell's bins of the means' power, shape (n_cells,)
    # Likewise, of how the means over quarters of the dwell differ from that over all.
    unrest: NDArray[np.float64]
    noise_db: float | None  # receiver's noise; None where motion hides it
    at_limit: float  # share of samples with a part as large as any


def read_cells(dwell: Dwell) -> CellReading | None:
    """Return the reading of a dwell; None when it has no room for two cells or four parts."""
    n_bins = max(1, round(CELL_M / dwell.axis.bin_length_m))
    n_cells = dwell.frames.shape[1] // n_bins
    rows = dwell.frames if not dwell.n_lost else dwell.frames[dwell.valid]
    # Every fourth frame tells as much about what stands still, where there are enough.
    rows = rows[:: _EVERY if len(rows) >= 8 * _EVERY else 1]
    n_rows = len(rows) // _PARTS * _PARTS
    if n_cells < 2 or n_rows == 0:
        return None
    used = rows[-n_rows:, : n_cells * n_bins]
    parts = used.reshape(_PARTS, n_rows // _PARTS, -1).mean(axis=1, dtype=np.complex128)
    mean = parts.mean(axis=0)
    size = np.maximum(np.abs(used.real), np.abs(used.imag))
    shape = (n_cells, n_bins)
    return CellReading(
        echoes=mean.reshape(shape),
        energy=power_of(mean).reshape(shape).sum(axis=1),
        unrest=power_of(parts - mean).mean(axis=0).reshape(shape).sum(axis=1),
        noise_db=_noise_db(dwell, shape),
        at_limit=float((size == size.max()).mean()) if size.any() else 0.0,
    )


def is_frozen(dwell: Dwell) -> bool:
    """Return whether the newest frames are all the same: a receiver that lives has noise."""
    rows = dwell.frames[dwell.valid][-_NOISE_FRAMES:]
    return len(rows) >= 4 and bool((rows[1:] == rows[0]).all())


def _noise_db(dwell: Dwell, shape: tuple[int, int]) -> float | None:
    """Return the noise of the newest frames, where first and second differences agree."""
    # White noise of power s has differences of power 2 s and second differences of 6 s; motion
    # that the frames follow has less in the second. Motion that they do not follow looks
    # white, but not alike at all ranges.
    n = min(_NOISE_FRAMES, len(dwell.frames))
    if n < 4 or not dwell.valid[-n:].all():
        return None
    rows = dwell.frames[-n:, : shape[0] * shape[1]].astype(np.complex128)
    steps = rows[1:] - rows[:-1]
    first = _cell_power(steps, shape) / 2
    second = _cell_power(steps[1:] - steps[:-1], shape) / 6
    if not (second > 0).all():
        return None
    white = second / first
    level_db = 10 * np.log10(second)
    is_noise = (
        quantile(white, 0.1) >= _MIN_WHITE
        and quantile(white, 0.5) <= _MAX_WHITE
        and quantile(level_db, 0.9) - quantile(level_db, 0.1) <= _MAX_SPREAD_DB
    )
    return quantile(level_db, 0.5) if is_noise else None


def quantile(values: NDArray[np.float64], share: float) -> float:
    """Return the nearest of a few values to a quantile; numpy's own takes ten times as long."""
    return float(np.sort(values)[round(share * (len(values) - 1))])


def power_of(x: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the power of every sample."""
    return np.asarray(x.real**2 + x.imag**2)


def _cell_power(x: NDArray[np.complex128], shape: tuple[int, int]) -> NDArray[np.float64]:
    parts = x.view(np.float64)
    by_part = np.einsum("tn,tn->n", parts, parts) / len(x)
    return np.asarray(by_part.reshape(shape[0], -1).sum(axis=1) / shape[1])
