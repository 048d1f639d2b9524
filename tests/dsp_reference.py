"""The maps of motion by their definitions, in float64, and streams that they are judged on."""

import numpy as np

from radard.dsp.clutter import block_power, noise_of, second_differences, sound_rows
from radard.dsp.doppler import gaussian_taper
from radard.dsp.jitter import take_out_jitter
from tests.radar_helpers import noise
from tests.sim_helpers import axis_with
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis

X2 = axis_with("baseband", 96, 8 * 0.003656, 0.6)
P4XX = axis_with("baseband", 480, 9.149e-3, 2.62, 4.0e9, 1.7e9, 0.0)
X4 = axis_with("baseband", 91, 51.4e-3, 0.4, 7.29e9, 1.4e9, 0.0)


def error(ours: np.ndarray, reference: np.ndarray) -> float:
    """Relative error, norm over norm, of arrays of any level."""
    scale = np.abs(reference).max() or 1.0
    return float(np.linalg.norm((ours - reference) / scale) / np.linalg.norm(reference / scale))


def point(axis: FastTimeAxis, rate_hz, n_slow, *, velocity_mps, middle_m) -> np.ndarray:
    """A matched-filtered point that passes `middle_m` in mid-record, complex64."""
    t_s = (np.arange(n_slow) - (n_slow - 1) / 2) / rate_hz
    range_m = middle_m - velocity_mps * t_s
    sigma_s = np.sqrt(np.log(10)) / (np.pi * axis.bandwidth_hz) * np.sqrt(2)
    late_s = 2 * (axis.range_m - range_m[:, None]) / SPEED_OF_LIGHT_MPS
    turns = 2 * range_m[:, None] * axis.carrier_hz / SPEED_OF_LIGHT_MPS
    echo = np.exp(-0.5 * (late_s / sigma_s) ** 2) * np.exp(-2j * np.pi * turns)
    return echo.astype(np.complex64)


def under_clutter(moving: np.ndarray, clutter_db: float, seed: int = 7) -> np.ndarray:
    """Motion with static clutter so many dB above it, as float32 holds it."""
    level = 10 ** (clutter_db / 20) * float(np.sqrt(np.mean(np.abs(moving) ** 2)))
    clutter = noise(1, moving.shape[1], seed=seed).astype(np.complex128) * level
    return (moving + clutter).astype(np.complex64)


def micro_doppler_direct(frames, n_cpi, taper=None):
    """Return mu, shape (n_cpi, n_columns): mean off, taper on, DFT, power summed over range."""
    y = np.asarray(frames, np.complex128)
    weights = (gaussian_taper(n_cpi) if taper is None else taper)[:, None]
    columns = []
    for i in range(len(y) - n_cpi + 1):
        # Off with one frame first: the mean of strong clutter is not exact either.
        cpi = y[i : i + n_cpi] - y[i]
        g = np.fft.fft(weights * (cpi - cpi.mean(axis=0)), axis=0)
        columns.append(np.fft.fftshift((np.abs(g) ** 2).sum(axis=1)))
    return np.stack(columns, axis=1)


def velocity_transform_direct(spectra, frequency_hz, rate_hz, *, velocity_mps, taper, stride):
    """Return P(v, t0), shape (n_velocity, n_columns), of spectra, shape (n_slow, n_freq)."""
    x = np.asarray(spectra, np.complex128)
    n_cpi = len(taper)
    time_s = (np.arange(n_cpi) - (n_cpi - 1) / 2) / rate_hz
    columns = []
    for i in range(0, len(x) - n_cpi + 1, stride):
        cpi = x[i : i + n_cpi] - x[i]
        cpi = (cpi - cpi.mean(axis=0)) * taper[:, None]
        power = np.zeros(len(velocity_mps))
        for k, f in enumerate(frequency_hz):
            turns = 2 * f / SPEED_OF_LIGHT_MPS * np.outer(velocity_mps, time_s)
            power += np.abs(np.exp(-2j * np.pi * turns) @ cpi[:, k]) ** 2
        columns.append(power)
    return np.stack(columns, axis=1)


def residual_power(frames, valid, n_cpi):
    """Return the residual power of every range bin, CPI by CPI, as the gate takes it."""
    rows, usable, scale = sound_rows(frames, valid)
    return block_power(rows, usable, n_cpi, 1)[0][:, 0] * scale**2


def noise_power(frames, valid):
    """Return the receiver's noise power per live bin and frame, as the gate takes it."""
    rows, usable, scale = sound_rows(frames, valid)
    return noise_of(second_differences(rows, usable)) * scale**2


def remove_jitter(frames, valid, axis):
    """Return frames without the clutter's common delay and gain, and both as fitted."""
    rows, usable, scale = sound_rows(frames, valid)
    turn_rad, gain = take_out_jitter(rows, usable, axis)
    parts = rows.view(np.float32)
    parts *= np.float32(scale)
    return rows, turn_rad / (2 * np.pi * axis.carrier_hz), gain
