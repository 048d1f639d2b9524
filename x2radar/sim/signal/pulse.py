"""From ranges to echoes: the pulse, the radar equation, and RF samples as the thesis has them.

The pulse is the thesis' Gaussian (2.3): ``p(t) = exp(-t^2 / (2 sp^2))`` on a carrier. Its
centre, not its start, defines the delay, so that the range axis reads true.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS

Array = NDArray[np.float64]
REACH_SIGMA = 5.0
"""Samples further from an echo are left out: the pulse has fallen to 4e-6 (-108 dB)."""
NEAREST_M = 0.1
"""Nearer points count as here: the near field has no radar equation."""
BOLTZMANN = 1.380_649e-23
"""J/K, exact (SI 2019)."""
ROOM_K = 290.0
"""Standard noise temperature (IEEE)."""


def pulse_sigma_s(bandwidth_hz: float) -> float:
    """Return the sigma of a Gaussian pulse from its bandwidth at -10 dB, in seconds.

    The spectrum's amplitude is exp(-2 (pi f sp)^2); it is -10 dB at f = bandwidth / 2.
    """
    return float(np.sqrt(np.log(10) / 4) / (np.pi * bandwidth_hz / 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkBudget:
    """What decides the signal-to-noise ratio (the thesis' table B.5)."""

    tx_power_w: float = 1e-3  # peak of the pulse (0 dBm)
    antenna_gain: float = 10**0.4  # gain of either antenna, linear (4 dB)
    noise_figure: float = 10**1.3  # of the receiver, linear (13 dB), referred to its input
    # In the module's unit, 0 to 100 over the threshold sweep; measured on an X2 in open air at 128
    # integrations.
    noise_sigma: float = 0.04

    def amplitude(self, range_m: Array, rcs_m2: Array, axis: FastTimeAxis) -> Array:
        """Return the peak amplitude of RF echoes in the module's unit (2.11, 2.13).

        Ranges, in metres, are of shape (..., n_scatterers), cross sections (n_scatterers,);
        nearer than 0.1 m counts as 0.1 m. The axis gives wavelength and noise bandwidth (the
        sampling rate, as the thesis has it).
        """
        wavelength_m = SPEED_OF_LIGHT_MPS / axis.carrier_hz
        r = np.maximum(range_m, NEAREST_M)
        received_w = (
            self.tx_power_w
            * self.antenna_gain**2
            * wavelength_m**2
            * rcs_m2
            / ((4 * np.pi) ** 3 * r**4)
        )
        noise_w = BOLTZMANN * ROOM_K * self.noise_figure * axis.sample_rate_hz
        return np.asarray(self.noise_sigma * np.sqrt(2 * received_w / noise_w))


def rf_echo(range_m: Array, amplitude: Array, axis: FastTimeAxis) -> NDArray[np.float32]:
    """Return RF frames of moving points, shape (n_slow, n_range), sampled at the axis' rate.

    ``sum_k a_k p(t - tau_k) cos(2 pi fc (t - tau_k))`` (2.12), ranges, constant within a frame
    (2.16), and peak amplitudes of shape (n_slow, n_scatterers). The phase is computed from the
    time since the echo's centre, in float64: error below 1e-6 of a turn.
    """
    sigma_s = pulse_sigma_s(axis.bandwidth_hz)
    bin_s = 2 * axis.bin_length_m / SPEED_OF_LIGHT_MPS
    half = int(np.ceil(REACH_SIGMA * sigma_s / bin_s))
    offsets = np.arange(-half, half + 1)
    position = (range_m - axis.range_offset_m) / axis.bin_length_m
    seen = (position > -half) & (position < axis.n_range - 1 + half)
    out = np.zeros((len(range_m), axis.n_range), np.float32)
    for k in range(range_m.shape[1]):
        rows = np.flatnonzero(seen[:, k])
        bins = np.rint(position[rows, k]).astype(np.int64)[:, None] + offsets
        since_s = (bins - position[rows, k, None]) * bin_s
        envelope = np.exp(since_s**2 * (-0.5 / sigma_s**2))
        pulse = envelope * np.cos(2 * np.pi * axis.carrier_hz * since_s)
        echo = amplitude[rows, k, None] * pulse
        inside = (bins >= 0) & (bins < axis.n_range)
        row_index = np.broadcast_to(rows[:, None], bins.shape)
        # Within one scatterer no (frame, bin) pair comes twice, so plain indexing adds.
        out[row_index[inside], bins[inside]] += echo[inside].astype(np.float32)
    return out
