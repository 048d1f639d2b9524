"""Frequencies of the wideband velocity transform: which ones, and by what matrices.

Absolute frequencies are the carrier plus the baseband frequencies of the DFT over range.
"""

import numpy as np
from numpy.typing import NDArray

from radard.dsp.gram import Reals, centring
from radard.errors import FeatureError
from x2radar.frame import FastTimeAxis
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS

_REACH = 1.3 / 2.3  # of the -10 dB band, to either side: beyond it is noise
_UNKNOWN_BANDWIDTH = 0.2  # of the carrier: less than any module's


def range_frequencies(axis: FastTimeAxis, n_most: int = 64) -> Reals:
    """Return the absolute frequencies at which a stream's frames are looked at, in hertz.

    Shape (n_freq,), float64: around the carrier, ascending, over 1.13 of the -10 dB band (1.3 GHz
    to either side for the X2) as far as the bins sample it. They are c / (2 swath) apart, all that
    differ for that many bins, or a multiple of it to stay within `n_most`. An unknown bandwidth is
    taken for a fifth of the carrier. Raises FeatureError if the axis has no carrier or no bins.
    """
    if axis.carrier_hz <= 0 or axis.bin_length_m <= 0 or n_most < 1:
        msg = f"no frequencies: carrier {axis.carrier_hz:g} Hz, bins of {axis.bin_length_m:g} m"
        raise FeatureError(msg)
    bandwidth_hz = axis.bandwidth_hz or _UNKNOWN_BANDWIDTH * axis.carrier_hz
    sampled_hz = SPEED_OF_LIGHT_MPS / (2 * axis.bin_length_m)
    reach_hz = min(_REACH * bandwidth_hz, 0.49 * sampled_hz)
    spacing_hz = sampled_hz / axis.n_range
    n_side = int(reach_hz / spacing_hz)
    thin = -(-(2 * n_side + 1) // n_most)
    n_side //= thin
    return np.asarray(axis.carrier_hz + np.arange(-n_side, n_side + 1) * (thin * spacing_hz))


def range_dft(axis: FastTimeAxis, frequency_hz: Reals, flatten: float) -> NDArray[np.complex128]:
    """Return the DFT over range, and the weights of the frequencies, as one matrix.

    Shape (n_range, n_freq), complex128: frames times this are X. `flatten` is the exponent of the
    pulse's amplitude spectrum (one at the carrier) that is divided out; nothing is when the
    bandwidth is unknown. Unflattened, the squares' sum over all of the sampled band would be the
    sum of the bins' power (Parseval), however the frequencies are spaced.
    """
    delay_s = 2 * axis.bin_length_m / SPEED_OF_LIGHT_MPS
    baseband_hz = frequency_hz - axis.carrier_hz
    spacing_hz = np.ptp(frequency_hz) / max(len(frequency_hz) - 1, 1) or 1 / delay_s
    weight = np.full(len(frequency_hz), np.sqrt(delay_s * spacing_hz))
    if axis.bandwidth_hz > 0:
        # -10 dB at half the bandwidth.
        weight *= 10 ** (0.5 * flatten * (2 * baseband_hz / axis.bandwidth_hz) ** 2)
    turns = np.outer(np.arange(axis.n_range) * delay_s, baseband_hz)
    return np.asarray(np.exp(-2j * np.pi * (turns % 1.0)) * weight)


def velocity_operator(
    frequency_hz: Reals, velocity_mps: Reals, frame_rate_hz: float, taper: Reals
) -> NDArray[np.complex128]:
    """Return what leads from steps to velocities, (n_freq, n_velocity, n_cpi - 1)."""
    n_cpi = len(taper)
    time_s = (np.arange(n_cpi) - (n_cpi - 1) / 2) / frame_rate_hz
    doppler_hz = 2 / SPEED_OF_LIGHT_MPS * np.multiply.outer(frequency_hz, velocity_mps)
    turns = np.multiply.outer(doppler_hz, time_s) % 1.0
    return np.asarray((np.exp(-2j * np.pi * turns) * taper) @ centring(n_cpi))
