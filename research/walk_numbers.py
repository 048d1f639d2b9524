"""Numbers of a walk that are sound at 30 frames a second.

Static clutter is removed and power by range and time is made as in `radard`; then the body is
followed through that map, and its way is cut into what counts (on the way to the radar or
from it) and what does not (turns, stops, the ends).

A walker's feet alias at such a rate, so nothing here reads their velocity off a Doppler axis.
Measured instead: where the body's power is from frame to frame; how far limbs reach out of it
*towards the radar*, where no multipath falls; and how fast the parts move against each other
once the body's own way is taken out of every frame, within the unambiguous interval.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from radard.detect.clutter_map import ClutterRemover
from radard.dsp.doppler import gaussian_taper
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.velocity import CPI_S, range_dft, range_frequencies
from radard.errors import FeatureError
from radard.stream.ring import Dwell
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Frames = NDArray[np.complex64]

CELL_M = 0.03
CLUTTER_S = 1.0
"""Length of the mean that a frame loses: a standing foot and a slow trunk stay in."""
PATH_S = 2.5
"""The way is a parabola over this time: two to four steps of a slow walk."""
SLOWEST_MPS = 0.12
BODY_M = 0.4
"""Half of what a body takes of the range: at full stride its feet are 0.35 m from its hips."""
BEHIND_M = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
"""Where multipath is measured, in metres behind the body."""
STEP_HZ = (0.5, 2.5)
"""Where swinging is looked for: strides and steps of walks from 0.2 to 1.5 m/s."""
SLOW_STEP_HZ = (0.6, 1.7)
"""Where steps are looked for: walks of 0.2 to 1 m/s."""
_FASTEST_MPS, _PENALTY_DB = 2.5, 0.5  # of a ridge: limbs of a slow walk are slower; by eye
_SHORTEST_S = 4.0  # of a record: the way needs 2.5 s
_QUIETEST = 0.02  # quantile that is taken for an empty cell
_PEAK_M = 0.25  # the peak is that near to the way: a trunk's depth
_EDGE_DB, _LIMB_DB = 6.0, 15.0  # trunk and limbs under the peak: by eye
_FARTHEST_EDGE_M = 1.0  # farther than any limb
_TRUNK_MPS, _LIMB_MPS = 0.3, 0.25  # about the body's way: by eye
_GATE_M, _GATE_EDGE_M = (-0.7, 0.35), 0.1  # limbs reach ahead, multipath falls behind
_STEP_MPS, _LINE_CPI_S = 0.05, 1 / 3  # half of what such a CPI resolves; a third of a step
_FLATTEN = 1.5  # as the velocity map's
_SHORTEST_RUN_S = 3.0  # two strides
_N_FFT = 2048  # lines 0.015 Hz apart
_TINY = 1e-300  # no division by zero


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """A record without clutter, and the way of the body in it."""

    # (n_slow, n_range): baseband without static clutter, but for half a second at either end,
    # where the mean has no room
    frames: Frames
    axis: FastTimeAxis  # of the frames
    frame_rate_hz: float
    power: Array  # (n_cells, n_slow): range-time map
    range_m: Array  # (n_cells,): middles of its cells
    noise: float  # power of an empty cell
    body_m: Array  # (n_slow,): range of the body: centre of the power within `BODY_M` of its way
    # (n_slow,): its way without the steps, and how fast the range grows
    path_m: Array
    rate_mps: Array
    is_walking: Flags  # (n_slow,): frames that count


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkNumbers:
    """What is measured of a walk; lengths are rms or medians over the frames that count."""

    speed_mps: float
    speed_sd_mps: float
    rate_sd_mps: float
    torso_mps: float
    torso_rms_m: float
    step_hz: float
    edge_rms_m: float
    reach_m: float
    far_reach_m: float
    swing_rms_m: float
    limb_mps: float
    coherence: float
    extent_m: float
    behind_db: tuple[float, ...]

    def row(self) -> Array:
        """Return all numbers in order, shape (13 + 6,)."""
        values = [getattr(self, f.name) for f in fields(self)]
        return np.array([*values[:-1], *values[-1]], np.float64)


def follow(frames: Frames, axis: FastTimeAxis, frame_rate_hz: float) -> Walk:
    """Return the way of the one body in a record.

    Frames are baseband, shape (n_slow, n_range), clutter and all; the body should move from the
    first to the last. Raises FeatureError if the record is shorter than 4 s, or nobody walks in
    it.
    """
    n = len(frames)
    if n < _SHORTEST_S * frame_rate_hz:
        msg = f"{n} frames at {frame_rate_hz:.1f} Hz: a walk needs {_SHORTEST_S:g} s or more"
        raise FeatureError(msg)
    dwell = Dwell(frames, np.ones(n, np.bool_), axis, frame_rate_hz, n / frame_rate_hz)
    clean = ClutterRemover().remove(dwell).frames
    n_cpi = round(CLUTTER_S * frame_rate_hz)
    ranges = RangeTimeMap(axis, n_cpi, cell_m=CELL_M, n_keep=n)
    ranges.push(clean)
    power = np.asarray(ranges.columns(), np.float64)
    noise = max(float(np.quantile(power, _QUIETEST)), float(np.finfo(np.float64).tiny))
    level = np.maximum(power, noise)
    cell = ridge(10 * np.log10(level), _FASTEST_MPS / frame_rate_hz / CELL_M)
    rough_m, _, _ = _way(_centre_m(level, ranges.range_m, ranges.range_m[cell]), frame_rate_hz)
    # About the way, not the ridge, which jumps from one part of the body to another.
    body_m = _centre_m(level, ranges.range_m, rough_m)
    path_m, rate_mps, is_walking = _way(body_m, frame_rate_hz)
    if not is_walking.any():
        msg = f"nobody walks to or from the radar at {SLOWEST_MPS:g} m/s or more"
        raise FeatureError(msg)
    return Walk(
        frames=clean[n_cpi // 2 :][: power.shape[1]],
        axis=axis,
        frame_rate_hz=frame_rate_hz,
        power=power,
        range_m=ranges.range_m,
        noise=noise,
        body_m=body_m,
        path_m=path_m,
        rate_mps=rate_mps,
        is_walking=is_walking,
    )


def _centre_m(power: Array, range_m: Array, about_m: Array) -> Array:
    """Return the centre of the power within `BODY_M` of places, shape (n_slow,)."""
    weight = np.where(np.abs(range_m[:, None] - about_m) <= BODY_M, power, 0.0)
    return np.asarray(range_m @ weight / weight.sum(axis=0))


def _way(body_m: Array, frame_rate_hz: float) -> tuple[Array, Array, Flags]:
    """Return way, range rate and the frames that count."""
    n, width = len(body_m), round(PATH_S * frame_rate_hz) | 1
    # Twice: once has a side lobe of -0.25, which would make the swing of a step larger.
    smooth_m = savgol_filter(body_m, width, 2)
    path_m = savgol_filter(smooth_m, width, 2)
    rate_mps = savgol_filter(smooth_m, width, 2, deriv=1, delta=1 / frame_rate_hz)
    # Near a turn or a stop the parabola does not fit.
    beside = np.ones(2 * (width // 3) + 1)
    is_turning = np.convolve(np.abs(rate_mps) < SLOWEST_MPS, beside, "same") > 0.5
    frame = np.arange(n)
    inside = (frame >= width // 2) & (frame < n - width // 2)
    return path_m, rate_mps, inside & ~is_turning


def ridge(level_db: Array, max_cells: float) -> NDArray[np.intp]:
    """Return the strongest way through a map that never jumps (Viterbi)."""
    n_cells, n_time = level_db.shape
    steps = np.arange(-max(1, round(max_cells)), max(1, round(max_cells)) + 1)
    came_from = np.clip(np.arange(n_cells) + steps[:, None], 0, n_cells - 1)
    cost = _PENALTY_DB * np.abs(steps)[:, None]
    score = level_db[:, 0].copy()
    came = np.zeros((n_time, n_cells), np.intp)
    for k in range(1, n_time):
        options = score[came_from] - cost
        best = options.argmax(axis=0)
        came[k] = came_from[best, np.arange(n_cells)]
        score = options[best, np.arange(n_cells)] + level_db[:, k]
    row = np.zeros(n_time, np.intp)
    row[-1] = int(score.argmax())
    for k in range(n_time - 1, 0, -1):
        row[k - 1] = came[k, row[k]]
    return row


def measure(walk: Walk) -> WalkNumbers:
    """Return the numbers of a walk."""
    counts, rate_hz = walk.is_walking, walk.frame_rate_hz
    quick = savgol_filter(walk.body_m, round(CPI_S * rate_hz) | 1, 1, deriv=1, delta=1 / rate_hz)
    near, limbs = edge_m(walk, _EDGE_DB), edge_m(walk, _LIMB_DB)
    extent = edge_m(walk, _EDGE_DB, far=True) - near
    reach = (walk.path_m - limbs)[counts]
    frames = standing_still(walk)
    torso_mps, limb_mps, step_hz = _doppler(walk, frames)
    both = counts[:-1] & counts[1:]
    turned = np.vdot(frames[:-1][both], frames[1:][both])
    energy = np.sqrt(_energy(frames[:-1][both]) * _energy(frames[1:][both]))
    return WalkNumbers(
        speed_mps=float(np.abs(walk.rate_mps[counts]).mean()),
        speed_sd_mps=spread_about_lines(walk.rate_mps, counts, rate_hz),
        rate_sd_mps=float((quick - walk.rate_mps)[counts].std()),
        torso_mps=torso_mps,
        torso_rms_m=swing_rms(walk.body_m - walk.path_m, counts, rate_hz),
        step_hz=step_hz,
        edge_rms_m=swing_rms(near - walk.path_m, counts, rate_hz),
        reach_m=float(np.median(reach)),
        far_reach_m=float(np.quantile(reach, 0.9)),
        swing_rms_m=swing_rms(limbs - walk.path_m, counts, rate_hz),
        limb_mps=limb_mps,
        coherence=float(abs(turned) / energy) if energy > 0 else 0.0,
        extent_m=float(np.median(extent[counts])),
        behind_db=tuple(_behind_db(walk, away) for away in BEHIND_M),
    )


def edge_m(walk: Walk, below_db: float, *, far: bool = False) -> Array:
    """Return where the body ends, shape (n_slow,): the first place so far below its peak.

    Ranges are interpolated between cells, and no further than 1 m from the peak; `far` is the edge
    away from the radar. Whatever lies beyond a gap does not count: interference, but also a limb
    that is apart.
    """
    level = 10 * np.log10(np.maximum(walk.power, walk.noise))
    near = np.abs(walk.range_m[:, None] - walk.path_m) <= _PEAK_M
    peak = np.where(near, level, -np.inf).argmax(axis=0)
    column, way = np.arange(level.shape[1]), 1 if far else -1
    least = level[peak, column] - below_db
    out, last = np.zeros(len(column)), len(level) - 1
    is_out = np.zeros(len(column), np.bool_)
    for k in range(1, round(_FARTHEST_EDGE_M / CELL_M) + 1):
        here, before = np.clip(peak + way * k, 0, last), np.clip(peak + way * (k - 1), 0, last)
        a, b = level[before, column], level[here, column]
        ends = ~is_out & ((b < least) | (here == before))
        share = np.clip((a - least) / np.maximum(a - b, 1e-9), 0.0, 1.0)
        out[ends] = (k - 1 + share)[ends]
        is_out |= ends
    out[~is_out] = _FARTHEST_EDGE_M / CELL_M
    return np.asarray(walk.range_m[peak] + way * CELL_M * out)


def _behind_db(walk: Walk, away_m: float) -> float:
    """Return the mean power around a place behind the body, against the body's peak."""
    behind = walk.range_m[:, None] - walk.path_m
    peak = np.where(np.abs(behind) <= _PEAK_M, walk.power, 0.0).max(axis=0)
    part = (np.abs(behind - away_m) <= 0.25) & walk.is_walking
    # Columns in which the swath ends before that place are left out.
    part &= behind[-1] > away_m + 0.25 - CELL_M
    if not part.any():
        return float("nan")
    level = (walk.power / np.maximum(peak, walk.noise))[part].mean()
    return float(10 * np.log10(max(level, 1e-30)))


def _energy(frames: Frames) -> float:
    return float(np.vdot(frames, frames).real)


def standing_still(walk: Walk) -> Frames:
    """Return the frames with the body's way taken out, and multipath behind it cut off.

    Every frame is moved by its `path_m` (delay and phase, by the shift theorem), so that the
    body stands in the middle of the swath; what lies more than 0.7 m in front of it or 0.35 m
    behind is zero.
    """
    axis, n = walk.axis, walk.axis.n_range
    bin_s = 2 * axis.bin_length_m / SPEED_OF_LIGHT_MPS
    frequency = np.fft.fftfreq(2 * n, bin_s) + axis.carrier_hz
    middle_m = axis.range_m[n // 2]
    turn = 2 / SPEED_OF_LIGHT_MPS * np.outer(walk.path_m - middle_m, frequency)
    spectrum = np.fft.fft(walk.frames, 2 * n, axis=1) * np.exp(2j * np.pi * (turn % 1.0))
    still = np.fft.ifft(spectrum, axis=1)[:, :n]
    away = axis.range_m - middle_m
    gate = np.clip((away - _GATE_M[0]) / _GATE_EDGE_M, 0, 1)
    gate *= np.clip((_GATE_M[1] - away) / _GATE_EDGE_M, 0, 1)
    return np.asarray(still * gate, np.complex64)


def _doppler(walk: Walk, frames: Frames) -> tuple[float, float, float]:
    """Return how the trunk's line swings and how fast parts move about it (m/s), and steps (Hz).

    Of frames from `standing_still`. Only the unambiguous interval is looked at: faster parts fold
    into it, recorded or simulated.
    """
    counts, rate_hz = walk.is_walking, walk.frame_rate_hz
    columns, v, n_cpi = _velocities(walk, frames)
    columns = columns / np.maximum(columns.sum(axis=0), _TINY)
    middle = np.arange(columns.shape[1]) + n_cpi // 2

    def by_frame(x: Array) -> Array:
        return np.asarray(np.interp(np.arange(len(frames)), middle, x), np.float64)

    trunk = np.abs(v) <= _TRUNK_MPS
    line = v[trunk] @ columns[trunk] / np.maximum(columns[trunk].sum(axis=0), _TINY)
    quick = np.maximum(columns[np.abs(v) > _LIMB_MPS].sum(axis=0), 1e-6)
    frequency, density = _spectrum(by_frame(10 * np.log10(quick)), counts, rate_hz)
    part = (frequency >= SLOW_STEP_HZ[0]) & (frequency <= SLOW_STEP_HZ[1])
    # Noise is the same at all velocities.
    mean = columns[:, counts[middle]].mean(axis=1)
    mean -= mean.min()
    return (
        swing_rms(by_frame(line), counts, rate_hz),
        float(np.sqrt((mean * v**2).sum() / max(mean.sum(), _TINY))),
        float(frequency[part][density[part].argmax()]),
    )


def _velocities(walk: Walk, frames: Frames) -> tuple[Array, Array, int]:
    """Return power by velocity and time, the velocities, and the frames in a CPI.

    The daemon's velocity transform without its clutter removal, which would take away just
    the trunk that was made to stand still.
    """
    rate_hz = walk.frame_rate_hz
    n_side = int(SPEED_OF_LIGHT_MPS / walk.axis.carrier_hz * rate_hz / 4 / _STEP_MPS)
    v = np.arange(-n_side, n_side + 1) * _STEP_MPS
    n_cpi = max(4, round(_LINE_CPI_S * rate_hz))
    frequency_hz = range_frequencies(walk.axis)
    spectra = frames @ range_dft(walk.axis, frequency_hz, _FLATTEN)
    t_s = np.arange(n_cpi) / rate_hz
    power = np.zeros((len(frames) - n_cpi + 1, len(v)))
    for k, f_hz in enumerate(frequency_hz):
        turns = 2 * f_hz / SPEED_OF_LIGHT_MPS * np.outer(t_s, v)
        lines = gaussian_taper(n_cpi)[:, None] * np.exp(-2j * np.pi * turns)
        power += np.abs(sliding_window_view(spectra[:, k], n_cpi) @ lines) ** 2
    return np.asarray(power.T, np.float64), np.asarray(v, np.float64), n_cpi


def swing_rms(x: Array, counts: Flags, rate_hz: float) -> float:
    """Return the rms of what swings within `STEP_HZ`, the line through each stretch taken off."""
    frequency_hz, density = _spectrum(x, counts, rate_hz)
    part = (frequency_hz >= STEP_HZ[0]) & (frequency_hz <= STEP_HZ[1])
    return float(np.sqrt(density[part].sum() * frequency_hz[1]))


def spread_about_lines(x: Array, counts: Flags, rate_hz: float) -> float:
    """Return the rms of what is left of the stretches that count without a line through each.

    A straight way past a radar has a range rate that changes steadily, and corners lie
    between stretches: neither is in it.
    """
    return float(np.sqrt(np.mean(np.concatenate(_without_lines(x, counts, rate_hz)) ** 2)))


def _spectrum(x: Array, counts: Flags, rate_hz: float) -> tuple[Array, Array]:
    """Return frequencies from 0 and the one-sided density of power over all stretches."""
    total, weight = np.zeros(_N_FFT // 2 + 1), 0.0
    for bent in _without_lines(x, counts, rate_hz):
        taper = np.hanning(len(bent) + 2)[1:-1]
        spectrum = np.fft.rfft(bent * taper, _N_FFT)
        total += np.abs(spectrum) ** 2 * (len(bent) / (taper @ taper))
        weight += len(bent)
    frequency_hz = np.asarray(np.fft.rfftfreq(_N_FFT, 1 / rate_hz), np.float64)
    return frequency_hz, 2 * total / (weight * rate_hz)


def _without_lines(x: Array, counts: Flags, rate_hz: float) -> list[Array]:
    """Return the stretches that count less a line each; short ones only where there are no long.

    Stretches shorter than 3 s are left out, unless all are.
    """
    index = np.flatnonzero(counts)
    runs = np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)
    long = [run for run in runs if len(run) >= _SHORTEST_RUN_S * rate_hz] or runs
    lines = [np.polynomial.Polynomial.fit(run, x[run], min(1, len(run) - 1)) for run in long]
    return [
        np.asarray(x[run] - line(run), np.float64) for run, line in zip(long, lines, strict=True)
    ]
