"""The pass-band tier: echoes on their carrier, in float64, the reference of all others.

RF frames are written down as (2.12) has them. Baseband frames are made the long way: RF
samples finer than the carrier needs, mixing (2.18), correlation with the pulse (2.19),
and only then the bins that the axis asks for. It is slow, and it is meant to be: nothing
in it is clever.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis
from x2radar.settings.x2 import SPEED_OF_LIGHT_MPS
from x2radar.sim.echo.common import Amplitude, Array, Frames, Pulse, kept

_REACH_SIGMA = 7.0  # the pulse has fallen to 2e-11
_SAMPLES_PER_WAVE = 4
_BLOCK = 64


def frames(
    range_m: Array,
    amplitude: Amplitude,
    axis: FastTimeAxis,
    pulse: Pulse | None = None,
    *,
    error_db: float = -120.0,
    floor: float = 0.0,
) -> Frames:
    """Return frames by the definition.

    Parameters
    ----------
    range_m : ndarray, shape (n_slow, n_points), float64
        Distances, in metres; constant within a frame (2.16).
    amplitude : ndarray, shape (n_slow, n_points), float64 or complex128
        Peak amplitudes of the RF echoes, with no NaN among them.
    axis : FastTimeAxis
        Of either kind.
    pulse : Pulse, optional
        The axis' own by default.
    error_db : float
        Not used: the reference has one accuracy.
    floor : float
        Echoes up to this amplitude are left out.

    Returns
    -------
    ndarray, shape (n_slow, n_range), float32 (rf) or complex64 (baseband)
        RF: ``sum_k Re(a_k) p(t - tau_k) cos(2 pi fc (t - tau_k))`` and the quadrature part
        of complex amplitudes (2.12). Baseband: the matched filter's output (2.19), a point
        echo's peak being its amplitude. Nothing is cut off at the ends of the swath before
        the filter. Error below 1e-7 of the sum of amplitudes, which is float32's rounding.

    Raises
    ------
    SceneError
        If the shapes differ or the axis has no bandwidth.
    """
    del error_db
    pulse = pulse or Pulse.of(axis)
    sigma_m = pulse.sigma_m("rf")
    reach_m = _REACH_SIGMA * pulse.sigma_m(axis.kind)
    r, a = kept(range_m, amplitude, axis, reach_m=reach_m, floor=floor)
    if axis.kind == "rf":
        rf = np.zeros((len(r), axis.n_range), np.float32)
        for at in range(0, len(r), _BLOCK):
            part = slice(at, at + _BLOCK)
            rf[part] = _samples(r[part], a[part], axis.range_m, axis, sigma_m)
        return rf
    x_m, receiver = _receiver(axis, sigma_m)
    out = np.zeros((len(r), axis.n_range), np.complex64)
    for at in range(0, len(r), _BLOCK):
        part = slice(at, at + _BLOCK)
        out[part] = _samples(r[part], a[part], x_m, axis, sigma_m) @ receiver
    return out


def _samples(
    range_m: Array, amplitude: Amplitude, x_m: Array, axis: FastTimeAxis, sigma_m: float
) -> Array:
    """Return RF samples at the ranges `x_m`, shape (n_slow, x_m.size), float64."""
    per_m = 2 * axis.carrier_hz / SPEED_OF_LIGHT_MPS
    out = np.zeros((len(range_m), x_m.size))
    for k in range(range_m.shape[1]):
        since_m = x_m - range_m[:, k, None]
        envelope = np.exp(-0.5 * (since_m / sigma_m) ** 2)
        angle = 2 * np.pi * per_m * since_m
        wave = amplitude[:, k, None].real * np.cos(angle)
        if np.iscomplexobj(amplitude):
            # The frame's phase runs against the carrier's if the axis says so.
            wave += axis.phase_sign * amplitude[:, k, None].imag * np.sin(angle)
        out += envelope * wave
    return out


@lru_cache(maxsize=4)
def _receiver(axis: FastTimeAxis, sigma_m: float) -> tuple[Array, NDArray[np.complex128]]:
    """Return where RF is sampled, and mixing, matched filter and decimation as a matrix."""
    wave_m = SPEED_OF_LIGHT_MPS / (2 * axis.carrier_hz)
    per_bin = max(1, math.ceil(axis.bin_length_m / wave_m * _SAMPLES_PER_WAVE))
    step_m = axis.bin_length_m / per_bin
    margin = math.ceil(_REACH_SIGMA * sigma_m / step_m)
    m = np.arange(-margin, (axis.n_range - 1) * per_bin + margin + 1)
    x_m = axis.range_offset_m + step_m * m
    pulses = np.exp(-0.5 * ((x_m[:, None] - axis.range_m) / sigma_m) ** 2)
    energy = np.sum(np.exp(-0.5 * (np.arange(-margin, margin + 1) * step_m / sigma_m) ** 2) ** 2)
    turns = axis.phase_sign * ((x_m / wave_m) % 1.0)
    mixer = np.exp(2j * np.pi * turns) * (2 / energy)
    return np.asarray(x_m), np.asarray(pulses * mixer[:, None])
