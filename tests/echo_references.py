"""References for echoes: written down as the thesis has them, in float64, slow on purpose.

`passband` makes frames on the carrier, and baseband frames the long way: RF samples finer than
the carrier needs, mixing (2.18), correlation with the pulse (2.19), and only then the bins that
the axis asks for. All tiers of `x2radar.sim.echo` are measured against it.
"""

import math
from functools import lru_cache

import numpy as np

from x2radar.frame import SPEED_OF_LIGHT_MPS
from x2radar.sim.echo import echo_sigma_m, frames

REACH_SIGMA = 7.0  # the pulse has fallen to 2e-11
SAMPLES_PER_WAVE = 4
BLOCK = 64


def baseband_echo(range_m, amplitude, axis):
    """Matched-filtered frames of points with real amplitudes: the finest tier's."""
    return frames(range_m, amplitude, axis, error_db=-130.0)


def passband(range_m, amplitude, axis):
    """Frames of moving points, arguments and result as `x2radar.sim.echo.frames` has them.

    RF: ``sum_k a_k p(t - tau_k) cos(2 pi fc (t - tau_k))`` (2.12). Baseband: the matched filter's
    output (2.19); nothing is cut off at the ends of the swath before the filter. Error below 1e-7
    of the sum of amplitudes, which is float32's rounding.
    """
    sigma_m = echo_sigma_m(axis, "rf")
    if axis.kind == "rf":
        x_m, receiver = axis.range_m, None
        out = np.zeros((len(range_m), axis.n_range), np.float32)
    else:
        x_m, receiver = _receiver(axis, sigma_m)
        out = np.zeros((len(range_m), axis.n_range), np.complex64)
    for at in range(0, len(range_m), BLOCK):
        part = slice(at, at + BLOCK)
        rf = _samples(range_m[part], amplitude[part], x_m, axis, sigma_m)
        out[part] = rf if receiver is None else rf @ receiver
    return out


def _samples(range_m, amplitude, x_m, axis, sigma_m):
    """RF samples at the ranges `x_m`, shape (n_slow, x_m.size), float64."""
    per_m = 2 * axis.carrier_hz / SPEED_OF_LIGHT_MPS
    out = np.zeros((len(range_m), x_m.size))
    for k in range(range_m.shape[1]):
        since_m = x_m - range_m[:, k, None]
        envelope = np.exp(-0.5 * (since_m / sigma_m) ** 2)
        out += envelope * amplitude[:, k, None] * np.cos(2 * np.pi * per_m * since_m)
    return out


@lru_cache(maxsize=4)
def _receiver(axis, sigma_m):
    """Where RF is sampled; mixing, matched filter and decimation as a matrix."""
    wave_m = SPEED_OF_LIGHT_MPS / (2 * axis.carrier_hz)
    per_bin = max(1, math.ceil(axis.bin_length_m / wave_m * SAMPLES_PER_WAVE))
    step_m = axis.bin_length_m / per_bin
    margin = math.ceil(REACH_SIGMA * sigma_m / step_m)
    m = np.arange(-margin, (axis.n_range - 1) * per_bin + margin + 1)
    x_m = axis.range_offset_m + step_m * m
    pulses = np.exp(-0.5 * ((x_m[:, None] - axis.range_m) / sigma_m) ** 2)
    energy = np.sum(np.exp(-0.5 * (np.arange(-margin, margin + 1) * step_m / sigma_m) ** 2) ** 2)
    turns = axis.phase_sign * ((x_m / wave_m) % 1.0)
    mixer = np.exp(2j * np.pi * turns) * (2 / energy)
    return x_m, pulses * mixer[:, None]
