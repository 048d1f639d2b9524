"""Numbers of a walk that are sound at 30 frames a second.

A walker's feet alias at such a rate, so nothing here reads their velocity off a Doppler axis.
Measured instead: where the body's power is from frame to frame; how far limbs reach out of it
*towards the radar*, where no multipath falls; and how fast the parts move against each other
once the body's own way is taken out of every frame, within the unambiguous interval.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from radard.dsp.velocity import CPI_S
from research.walks.doppler import doppler_numbers, standing_still
from research.walks.follow import CELL_M, Array, Walk
from research.walks.swing import spread_about_lines, swing_rms

PEAK_M = 0.25  # the peak is that near to the way: chosen, a trunk's depth
BEHIND_M = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)  # where multipath is measured: chosen
EDGE_DB, LIMB_DB = 6.0, 15.0  # trunk and limbs: chosen by eye
_FARTHEST_EDGE_M = 1.0  # chosen: farther than any limb


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkNumbers:
    """What is measured of a walk."""

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


def measure(walk: Walk) -> WalkNumbers:
    """Return the numbers of a walk."""
    counts, rate_hz = walk.is_walking, walk.frame_rate_hz
    speed = np.abs(walk.rate_mps[counts])
    quick = savgol_filter(walk.body_m, round(CPI_S * rate_hz) | 1, 1, deriv=1, delta=1 / rate_hz)
    near, limbs = edge_m(walk, EDGE_DB), edge_m(walk, LIMB_DB)
    extent = edge_m(walk, EDGE_DB, far=True) - near
    reach = (walk.path_m - limbs)[counts]
    frames = standing_still(walk)
    doppler = doppler_numbers(walk, frames)
    both = counts[:-1] & counts[1:]
    turned = np.vdot(frames[:-1][both], frames[1:][both])
    energy = np.sqrt(_energy(frames[:-1][both]) * _energy(frames[1:][both]))
    return WalkNumbers(
        speed_mps=float(speed.mean()),
        speed_sd_mps=spread_about_lines(walk.rate_mps, counts, rate_hz),
        rate_sd_mps=float((quick - walk.rate_mps)[counts].std()),
        torso_mps=doppler.torso_mps,
        torso_rms_m=swing_rms(walk.body_m - walk.path_m, counts, rate_hz),
        step_hz=doppler.step_hz,
        edge_rms_m=swing_rms(near - walk.path_m, counts, rate_hz),
        reach_m=float(np.median(reach)),
        far_reach_m=float(np.quantile(reach, 0.9)),
        swing_rms_m=swing_rms(limbs - walk.path_m, counts, rate_hz),
        limb_mps=doppler.limb_mps,
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
    near = np.abs(walk.range_m[:, None] - walk.path_m) <= PEAK_M
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
    peak = np.where(np.abs(behind) <= PEAK_M, walk.power, 0.0).max(axis=0)
    part = (np.abs(behind - away_m) <= 0.25) & walk.is_walking
    # Columns in which the swath ends before that place are left out.
    part &= behind[-1] > away_m + 0.25 - CELL_M
    if not part.any():
        return float("nan")
    level = (walk.power / np.maximum(peak, walk.noise))[part].mean()
    return float(10 * np.log10(max(level, 1e-30)))


def _energy(frames: NDArray[np.complex64]) -> float:
    return float(np.vdot(frames, frames).real)
