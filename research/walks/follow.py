"""One person's way through a radar record, made by the daemon's own processing.

Static clutter is removed and power by range and time is made as in `radard`; then the body is
followed through that map, and its way is cut into what counts (on the way to the radar or
from it) and what does not (turns, stops, the ends).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from radard.detect.clutter_map import ClutterRemover
from radard.dsp.range_time import RangeTimeMap
from radard.errors import FeatureError
from radard.stream.ring import Dwell
from x2radar.frame import FastTimeAxis

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

CELL_M = 0.03
CLUTTER_S = 1.0
"""Length of the mean that a frame loses: a standing foot and a slow trunk stay in."""
PATH_S = 2.5
"""The way is a parabola over this time: two to four steps of a slow walk."""
SLOWEST_MPS = 0.12
BODY_M = 0.4
"""Half of what a body takes of the range: at full stride its feet are 0.35 m from its hips."""
_FASTEST_MPS = 2.5  # chosen: limbs of a slow walk are slower
_PENALTY_DB = 0.5  # of a cell's jump: chosen by eye
_SHORTEST_S = 4.0  # chosen: the way needs 2.5 s
_QUIETEST = 0.02  # quantile that is taken for an empty cell


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """A record without clutter, and the way of the body in it."""

    # (n_slow, n_range): baseband without static clutter, but for half a second at either end,
    # where the mean has no room
    frames: NDArray[np.complex64]
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


def follow(frames: NDArray[np.complex64], axis: FastTimeAxis, frame_rate_hz: float) -> Walk:
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
    cell = ridge(10 * np.log10(np.maximum(power, noise)), _FASTEST_MPS / frame_rate_hz / CELL_M)
    level = np.maximum(power, noise)
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


def ridge(level_db: Array, most_cells: float) -> NDArray[np.intp]:
    """Return the strongest way through a map that never jumps (Viterbi)."""
    n_cells, n_time = level_db.shape
    steps = np.arange(-max(1, round(most_cells)), max(1, round(most_cells)) + 1)
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
