"""Detection on range-Doppler cells: CFAR by ordered statistic, with a known false-alarm rate.

A CPI's bins are taken apart by a DFT without taper, less the mean: cells of white noise are
independent and exponential, the mean of three neighbours is a gamma variable of shape three. A
bin's level is the median of its cells in the dwell (OS-CFAR, Rohling 1983), because still echoes
leave jitter that is white in Doppler, bounded so that no body hides itself (`MAX_RESIDUE`).
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from radard.dsp.cfar import floor_factor
from radard.dsp.clutter import Flags, block_power, repeat_usable

Array = NDArray[np.float64]
N_DOPPLER = 3
"""Doppler cells whose mean is tested; of 1, 3, 5, 7, 11 and 21 the best for weak people at 60 Hz,
and among the best three at 200 Hz (benchmarks/bench_gate.py makes such bodies)."""
MAX_RESIDUE = 2.0  # times the noise that a bin's residue may reach, as it did in simulated rooms
ALONE = 10.0  # times its threshold at which one CPI is enough: five times a burst of Wi-Fi's
_MIN_FACTOR = 1e-3  # instead of zero, for a gate that is always open


def doppler_peaks(
    rows: NDArray[np.complex64], usable: Flags, n_cpi: int
) -> tuple[Array, Array, Array]:
    """Return every bin's strongest Doppler cells, the level that they stand on, and all power.

    `rows` and `usable` are from `sound_rows`, cut into whole CPIs of `n_cpi` frames, at least
    four, from the end; a row that is not usable repeats the one before. The peak, shape (n_cpis,
    n_range), is the greatest mean over `N_DOPPLER` neighbouring cells, in the rows' unit squared,
    scaled so that the mean of white noise is its power per frame; CPIs of which less than a half
    is usable are left out. The residue, shape (n_range,), is the median of all cells, scaled
    likewise, zeros without a CPI. The power, shape (n_cpis, n_range), is as of `block_power`.
    """
    n_cpis = len(rows) // n_cpi
    used = n_cpis * n_cpi
    kept = usable[-used:].reshape(n_cpis, n_cpi).sum(axis=1) >= n_cpi / 2
    # What stands still goes first, all of it but rounding.
    moving = rows[-used:] - rows[int(np.argmax(usable))]
    if not usable[-used:].all():
        repeat_usable(moving, usable[-used:], ~usable[-used:])
    blocks = moving.reshape(n_cpis, n_cpi, -1)
    if not kept.all():
        blocks = blocks[kept]
    n_range = rows.shape[1]
    if not len(blocks):
        return np.zeros((0, n_range)), np.zeros(n_range), np.zeros((0, n_range))
    # Bins before frames: transforms along the last axis take half the time.
    spectra = np.fft.fft(blocks.transpose(0, 2, 1), axis=-1)[..., 1:]
    cells = spectra.real**2 + spectra.imag**2
    n_beside = min(N_DOPPLER, n_cpi - 1)
    sums = cells[..., : n_cpi - n_beside].copy()
    for k in range(1, n_beside):
        sums += cells[..., k : n_cpi - n_beside + k]
    peak = sums.max(axis=-1).astype(np.float64) / (n_beside * n_cpi)
    by_bin = np.ascontiguousarray(cells.transpose(1, 0, 2)).reshape(n_range, -1)
    k = by_bin.shape[1] // 2
    middle = np.partition(by_bin, k, axis=1)[:, k].astype(np.float64)
    if usable[-used:].all():
        power = cells.sum(axis=-1).astype(np.float64) / (n_cpi * (n_cpi - 1))
    else:
        power = block_power(rows, usable, n_cpi, 1)[0][:, 0]
    return peak, middle / (np.log(2) * n_cpi), power


def two_of_three(excess: Array) -> tuple[float, int]:
    """Return what two of three CPIs in a row reach, and the CPI that decided.

    `excess` is what every CPI reaches, shape (n_cpis,): the result is the second largest of the
    three where that is greatest. A CPI that reaches `ALONE` needs no second one, and one that is
    all there is counts as it is; without any the result is 0.
    """
    if len(excess) == 0:
        return 0.0, 0
    top = int(np.argmax(excess))
    if len(excess) == 1 or excess[top] >= ALONE:
        return float(excess[top]), top
    best, at = -1.0, 0
    for first in range(max(1, len(excess) - 2)):
        order = first + np.argsort(-excess[first : first + 3], kind="stable")
        if excess[order[1]] > best:
            best, at = float(excess[order[1]]), int(order[1])
    return best, at


@lru_cache(maxsize=32)
def cell_factor(share: float, n_cpis: int, n_cpi: int, n_range: int) -> float:
    """Return how far over its level a cell must stand, so that `share` of noise's dwells open.

    Two of three CPIs in a row must hold such a cell each, so a dwell's chance is at most that
    of a CPI squared, times the pairs of CPIs. All cells count as independent: neighbours share
    much of their noise, so the true rate is lower. A share of 1 or more opens on anything.
    """
    if share >= 1:
        return _MIN_FACTOR
    n_pairs = 2 * n_cpis - 3
    in_cpi = float(np.sqrt(share / n_pairs)) if n_pairs > 0 else share
    n_beside = min(N_DOPPLER, n_cpi - 1)
    chance = in_cpi / (max(1, n_cpi - n_beside) * n_range)
    return floor_factor(float(n_beside), chance)


@lru_cache(maxsize=32)
def usual_peak(n_cpi: int) -> float:
    """Return the mean of `doppler_peaks` for white noise of power 1; to 1 %, from a draw."""
    rng = np.random.default_rng(0)
    n_beside = min(N_DOPPLER, n_cpi - 1)
    cells = rng.standard_exponential((4000, n_cpi - 1))
    sums = np.cumsum(np.pad(cells, ((0, 0), (1, 0))), axis=1)
    return float((sums[:, n_beside:] - sums[:, :-n_beside]).max(axis=1).mean() / n_beside)
