"""Velocities of a walker's parts about the body's own way, within the unambiguous interval."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from radard.dsp.doppler import unambiguous_velocity_mps
from radard.dsp.gram import gaussian_taper
from radard.dsp.wideband import range_dft, range_frequencies
from research.walks.follow import Array, Walk
from research.walks.swing import swing_rms, swinging
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS

SLOW_STEP_HZ = (0.6, 1.7)
"""Where steps are looked for: walks of 0.2 to 1 m/s."""
TRUNK_MPS, LIMB_MPS = 0.3, 0.25  # about the body's way: chosen by eye
_GATE_M, _GATE_EDGE_M = (-0.7, 0.35), 0.1  # limbs reach ahead, multipath falls behind
_STEP_MPS = 0.05  # chosen: half of what the CPI resolves
_LINE_CPI_S = 1 / 3  # chosen: a third of a step
_FLATTEN = 1.5  # as the velocity map's
_TINY = 1e-300  # chosen: no division by zero


@dataclass(frozen=True, slots=True)
class DopplerNumbers:
    """Those of the `WalkNumbers` that are read off velocities about the body's own way."""

    torso_mps: float
    limb_mps: float
    step_hz: float


def doppler_numbers(walk: Walk, frames: NDArray[np.complex64]) -> DopplerNumbers:
    """Return how the trunk's line swings, how fast parts move about it, and how often.

    Of frames from `standing_still`. Only the unambiguous interval is looked at: faster parts fold
    into it, recorded or simulated.
    """
    columns, v, n_cpi = _velocities(walk, frames)
    columns = columns / np.maximum(columns.sum(axis=0), _TINY)
    middle = np.arange(columns.shape[1]) + n_cpi // 2

    def by_frame(x: Array) -> Array:
        return np.asarray(np.interp(np.arange(len(frames)), middle, x), np.float64)

    trunk = np.abs(v) <= TRUNK_MPS
    line = v[trunk] @ columns[trunk] / np.maximum(columns[trunk].sum(axis=0), _TINY)
    quick = np.maximum(columns[np.abs(v) > LIMB_MPS].sum(axis=0), 1e-6)
    frequency, density = swinging(
        by_frame(10 * np.log10(quick)), walk.is_walking, walk.frame_rate_hz
    )
    part = (frequency >= SLOW_STEP_HZ[0]) & (frequency <= SLOW_STEP_HZ[1])
    # Noise is the same at all velocities.
    mean = columns[:, walk.is_walking[middle]].mean(axis=1)
    mean -= mean.min()
    return DopplerNumbers(
        torso_mps=swing_rms(by_frame(line), walk.is_walking, walk.frame_rate_hz),
        limb_mps=float(np.sqrt((mean * v**2).sum() / max(mean.sum(), _TINY))),
        step_hz=float(frequency[part][density[part].argmax()]),
    )


def standing_still(walk: Walk) -> NDArray[np.complex64]:
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


def _velocities(walk: Walk, frames: NDArray[np.complex64]) -> tuple[Array, Array, int]:
    """Return power by velocity and time, the velocities, and the frames in a CPI.

    The daemon's velocity transform without its clutter removal, which would take away just
    the trunk that was made to stand still.
    """
    rate_hz = walk.frame_rate_hz
    most = unambiguous_velocity_mps(rate_hz, walk.axis.carrier_hz)
    n_side = int(most / _STEP_MPS)
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
