"""The maps of motion by their definitions, in float64: what the fast forms are held against."""

import numpy as np

from radard.dsp.clutter import block_power, noise_of, second_differences, sound_rows
from radard.dsp.gram import gaussian_taper
from radard.dsp.jitter import take_out_jitter
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS


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


def velocity_transform_direct(
    spectra, frequency_hz, frame_rate_hz, *, velocity_mps, taper, stride
):
    """Return P(v, t0), shape (n_velocity, n_columns), of spectra, shape (n_slow, n_freq)."""
    x = np.asarray(spectra, np.complex128)
    n_cpi = len(taper)
    time_s = (np.arange(n_cpi) - (n_cpi - 1) / 2) / frame_rate_hz
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
    """Return frames without the clutter's common delay and gain, and what was fitted."""
    rows, usable, scale = sound_rows(frames, valid)
    fit = take_out_jitter(rows, usable, axis)
    parts = rows.view(np.float32)
    parts *= np.float32(scale)
    return rows, fit
