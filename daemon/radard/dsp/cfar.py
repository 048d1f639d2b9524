"""Detection by ordered-statistic CFAR (Rohling 1983), on maps of residual power.

*Range and time*: a cell must stand out of its own noise floor and of its surroundings in range, on
the greater of both sides, because moving multipath fills the range behind a person.

*Range and Doppler*, with a known false-alarm rate: a CPI's bins are taken apart by a DFT without
taper, less the mean: cells of white noise are independent and exponential, the mean of three
neighbours is a gamma variable of shape three. A bin's level is the median of its cells in the
dwell, because still echoes leave jitter that is white in Doppler, bounded so that no body hides
itself (`MAX_RESIDUE`).
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from radard.dsp import clutter
from radard.dsp.velocity import CPI_S
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis

Array = NDArray[np.float64]
BLOCK_S = 0.12  # a quarter of a CPI
GUARD_M = 0.25  # a body's own extent on either side
WINDOW_M = 1.0  # how far the surroundings reach
PEAK_M = 0.3  # least distance of two peaks
RANK = 0.4  # of the ordered statistic: looks past a second body
FALSE_ALARM = 1e-4  # a cell and block, in noise
_REFERENCES = 12  # most reference cells a side: more cost time and tell little
# Moving multipath hardly changes within a block, so that its looks are not independent.
_ECHO_LOOKS = 2.0
_MAX_PEAKS = 8  # a block: as many tracks are followed
N_DOPPLER = 3
"""Doppler cells whose mean is tested; of 1, 3, 5, 7, 11 and 21 the best for weak people at 60 Hz,
and among the best three at 200 Hz (benchmarks/bench_gate.py makes such bodies)."""
MAX_RESIDUE = 2.0  # times the noise that a bin's residue may reach, as it did in simulated rooms
ALONE = 10.0  # times its threshold at which one CPI is enough: five times a burst of Wi-Fi's
_MIN_FACTOR = 1e-3  # instead of zero, for a gate that is always open


@dataclass(frozen=True, slots=True, eq=False)
class PowerMap:
    """Residual power over its floor, in blocks of slow time and cells of range."""

    ratio: Array
    time_s: Array
    range_m: Array
    cell_m: float
    n_looks: float


@dataclass(frozen=True, slots=True)
class Peak:
    """A cell that stands out of its neighbours, in one block."""

    range_m: float  # centre of its power
    power_db: float  # highest power over the floor


def power_map(
    frames: clutter.AnyFrames,
    valid: clutter.Flags,
    axis: FastTimeAxis,
    *,
    frame_rate_hz: float,
    end_s: float,
    floor: Array,
) -> PowerMap:
    """Return the map of residual power, in blocks of 0.12 s and cells of half the resolution.

    Of frames, shape (n_slow, n_range), and which of them are good; blocks without a usable one are
    left out. `end_s` is stream time behind the last frame, `floor` noise and background of every
    bin, shape (n_range,), in sample units squared. Relative error of a cell 1e-5, as in
    `block_power`, at any level of the samples from denormal to 1e30.
    """
    rows, usable, scale = clutter.sound_rows(frames, valid)
    n_cpi = min(max(4, round(CPI_S * frame_rate_hz)), len(rows))
    n_parts = max(1, min(round(CPI_S / BLOCK_S), n_cpi // 2))
    power, kept = clutter.block_power(rows, usable, n_cpi, n_parts)
    resolution_m = SPEED_OF_LIGHT_MPS / (2 * axis.bandwidth_hz) if axis.bandwidth_hz > 0 else 0.0
    cell_bins = max(1, round(resolution_m / 2 / axis.bin_length_m))
    starts = np.arange(0, axis.n_range, cell_bins)
    over = np.add.reduceat(power.reshape(-1, axis.n_range), starts, axis=1)
    # Dividing by the unit twice keeps the floor of tiny samples out of the denormals.
    under = np.add.reduceat(floor / scale / scale, starts)
    ratio = np.where(under > 0, over / np.where(under > 0, under, 1.0), 0.0)
    edges = clutter.part_edges(n_cpi, n_parts)
    middle = (edges + np.append(edges[1:], n_cpi)) / 2
    first = len(rows) - len(kept) * n_cpi + np.flatnonzero(kept) * n_cpi
    time_s = end_s - (len(rows) - (first[:, None] + middle)).ravel() / frame_rate_hz
    last = np.minimum(starts + cell_bins, axis.n_range) - 1
    range_m = (axis.range_m[starts] + axis.range_m[last]) / 2
    return PowerMap(ratio, time_s, range_m, cell_bins * axis.bin_length_m, n_cpi / n_parts)


def _os_level(ratio: Array, offsets: NDArray[np.intp], k: int) -> Array:
    """Return the level of every cell's surroundings: the greater of both sides' statistics."""
    level = np.zeros_like(ratio)
    n_cell = ratio.shape[1]
    if n_cell < offsets[-1] + 1:
        return level
    # The statistic of cells `first + offsets`, once for every place where they all fit.
    for first, step in ((0, offsets), (offsets[-1], -offsets)):
        cells = first + np.arange(n_cell - offsets[-1])
        statistic = np.partition(ratio[:, cells[:, None] + step], k, axis=-1)[..., k]
        level[:, cells] = np.maximum(level[:, cells], statistic)
    return level


@lru_cache(maxsize=64)
def os_factor(n_references: int, k: int, n_looks: float, false_alarm: float) -> float:
    """Return by what factor a cell must exceed the k-th of its references."""
    x, below, above = _gamma(n_looks)
    # The ordered statistic's distribution in probability is a beta distribution.
    p = np.linspace(0.0, 1.0, 4001)
    inner = p[1:-1]
    log_density = k * np.log(inner) + (n_references - k - 1) * np.log1p(-inner)
    mass = np.exp(log_density - log_density.max())
    level = np.interp(inner, below, x)
    low, high = 0.0, 60.0
    for _ in range(50):
        middle = (low + high) / 2
        tail = np.exp(np.interp(level * np.exp(middle / 4), x, above))
        alarms = float((tail * mass).sum() / mass.sum())
        low, high = (middle, high) if alarms > false_alarm else (low, middle)
    return float(np.exp(high / 4))


@lru_cache(maxsize=16)
def floor_factor(n_looks: float, false_alarm: float) -> float:
    """Return by what factor a mean of `n_looks` exceeds its known mean with `false_alarm`."""
    x, _, above = _gamma(n_looks)
    return float(np.interp(-np.log(false_alarm), -above, x) / n_looks)


@lru_cache(maxsize=16)
def _gamma(shape: float) -> tuple[Array, Array, Array]:
    """Return a grid, and on it a gamma variable's distribution and the log of its tail."""
    # By the trapezoidal rule: better than 1e-4 for probabilities from 1e-12. SciPy has these
    # functions, and takes a tenth of a second to load.
    root = np.linspace(1e-6, np.sqrt(shape + 12 * np.sqrt(shape) + 80), 20001)
    x = root**2
    log_density = (shape - 1) * np.log(x) - x - math.lgamma(shape) + np.log(2 * root)
    density = np.exp(log_density)
    steps = (density[1:] + density[:-1]) / 2 * np.diff(root)
    below = np.concatenate([[0.0], np.cumsum(steps)])
    above = np.concatenate([np.cumsum(steps[::-1])[::-1], [0.0]])
    return x, np.minimum(below / below[-1], 1.0), np.log(np.maximum(above, 1e-300))


def find_peaks(chart: PowerMap, least_db: float) -> list[list[Peak]]:
    """Return each block's peaks, `least_db` over the floor, strongest first, at most eight."""
    ratio, cell_m = chart.ratio, chart.cell_m
    guard = max(1, round(GUARD_M / cell_m))
    reach = max(guard + 2, round(WINDOW_M / cell_m))
    offsets = np.arange(guard + 1, reach + 1)
    offsets = offsets[:: -(-len(offsets) // _REFERENCES)]
    k = int(RANK * (len(offsets) - 1))
    level = _os_level(ratio, offsets, k)
    # The factor is that of one side; where both count, there are fewer false alarms.
    factor = os_factor(len(offsets), k, min(chart.n_looks, _ECHO_LOOKS), FALSE_ALARM)
    limit = max(10 ** (least_db / 10), floor_factor(chart.n_looks, FALSE_ALARM))
    stands_out = (ratio > limit) & (ratio > factor * level)
    near = max(1, round(PEAK_M / cell_m))
    before, after = np.zeros_like(ratio), np.zeros_like(ratio)
    for lag in range(1, min(near, ratio.shape[1] - 1) + 1):
        np.maximum(before[:, lag:], ratio[:, :-lag], out=before[:, lag:])
        np.maximum(after[:, :-lag], ratio[:, lag:], out=after[:, :-lag])
    # Of equal cells the nearest is the peak.
    is_peak = stands_out & (ratio > before) & (ratio >= after)
    peaks: list[list[Peak]] = [[] for _ in ratio]
    half = max(1, near // 2)
    for block, cell in np.argwhere(is_peak).tolist():
        part = slice(max(0, cell - half), cell + half + 1)
        weight = np.maximum(ratio[block, part] - level[block, cell], 0)
        centre = float(weight @ chart.range_m[part] / weight.sum())
        peaks[block].append(Peak(centre, float(10 * np.log10(ratio[block, cell]))))
    for found in peaks:
        found.sort(key=lambda peak: -peak.power_db)
        del found[_MAX_PEAKS:]
    return peaks


def doppler_peaks(
    rows: NDArray[np.complex64], usable: clutter.Flags, n_cpi: int
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
        clutter.repeat_usable(moving, usable[-used:], ~usable[-used:])
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
        power = clutter.block_power(rows, usable, n_cpi, 1)[0][:, 0]
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
