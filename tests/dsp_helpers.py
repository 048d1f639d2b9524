"""Streams of the radars that the feature extraction serves, and judges in float64."""

import numpy as np

from tests.radar_helpers import noise
from tests.sim_helpers import axis_with
from x2radar.frame import FastTimeAxis
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS

X2 = axis_with("baseband", 96, 8 * 0.003656, 0.6)
P4XX = axis_with(
    "baseband", 480, 9.149e-3, 2.62, carrier_hz=4.0e9, bandwidth_hz=1.7e9, sample_rate_hz=0.0
)
X4 = axis_with(
    "baseband", 91, 51.4e-3, 0.4, carrier_hz=7.29e9, bandwidth_hz=1.4e9, sample_rate_hz=0.0
)


def error(ours: np.ndarray, reference: np.ndarray) -> float:
    """Relative error, norm over norm, of arrays of any level."""
    scale = np.abs(reference).max() or 1.0
    return float(np.linalg.norm((ours - reference) / scale) / np.linalg.norm(reference / scale))


def point(
    axis: FastTimeAxis, rate_hz: float, n_slow: int, *, velocity_mps: float, middle_m: float
) -> np.ndarray:
    """A matched-filtered point that passes `middle_m` in mid-record, complex64."""
    t_s = (np.arange(n_slow) - (n_slow - 1) / 2) / rate_hz
    range_m = middle_m - velocity_mps * t_s
    sigma_s = np.sqrt(np.log(10)) / (np.pi * axis.bandwidth_hz) * np.sqrt(2)
    late_s = 2 * (axis.range_m - range_m[:, None]) / SPEED_OF_LIGHT_MPS
    turns = 2 * range_m[:, None] * axis.carrier_hz / SPEED_OF_LIGHT_MPS
    return (np.exp(-0.5 * (late_s / sigma_s) ** 2) * np.exp(-2j * np.pi * turns)).astype(
        np.complex64
    )


def under_clutter(moving: np.ndarray, clutter_db: float, seed: int = 7) -> np.ndarray:
    """Motion with static clutter so many dB above it, as float32 holds it."""
    level = 10 ** (clutter_db / 20) * float(np.sqrt(np.mean(np.abs(moving) ** 2)))
    clutter = noise(1, moving.shape[1], seed=seed).astype(np.complex128) * level
    return (moving + clutter).astype(np.complex64)
