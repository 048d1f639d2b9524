"""The pulse and the radar equation: how strong an echo is.

The pulse is the thesis' Gaussian (2.3): ``p(t) = exp(-t^2 / (2 sp^2))`` on a carrier. Its
centre, not its start, defines the delay, so that the range axis reads true.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import FastTimeAxis
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS

Array = NDArray[np.float64]
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
        sent = self.tx_power_w * self.antenna_gain**2 * wavelength_m**2
        received_w = sent * rcs_m2 / ((4 * np.pi) ** 3 * r**4)
        noise_w = BOLTZMANN * ROOM_K * self.noise_figure * axis.sample_rate_hz
        return np.asarray(self.noise_sigma * np.sqrt(2 * received_w / noise_w))
