"""Receiver noise as the matched filter leaves it, at any bin length.

White noise of the RF sampler becomes, behind mixing and filter, circular Gaussian noise
whose correlation over range is the pulse's own: exp(-d^2 / 4 s^2) at a distance d. It is
made as nature makes it, white numbers through the filter, but with one number a sigma of
the transmitted pulse instead of one a sample: about 100 instead of 768 for a whole frame.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.frame import FastTimeAxis
from x2radar.sim.echo.common import Baseband, Pulse

_MARGIN_SIGMA = 4.5  # beyond the ends; the filter has fallen to 4e-5


@dataclass(frozen=True, slots=True, eq=False)
class NoiseColour:
    """How noise of one axis is made from independent numbers.

    Attributes
    ----------
    matrix : ndarray, shape (n_white, n_range), float32
        White rows times this are noise of the RF sampler's standard deviation 1.
    sigma : float
        Standard deviation of one bin, real and imaginary part together, for that.
    """

    matrix: NDArray[np.float32]
    sigma: float

    @property
    def n_white(self) -> int:
        """Complex numbers to draw for a frame."""
        return len(self.matrix)

    def draw(self, rng: np.random.Generator, n_slow: int, sigma_rf: float) -> Baseband:
        """Return noise of some frames.

        Parameters
        ----------
        rng : numpy.random.Generator
            Consumed frame by frame, so pieces of any length give the same numbers, up to
            the rounding of the product.
        n_slow : int
            Frames.
        sigma_rf : float
            Standard deviation of one RF sample, in the module's unit.

        Returns
        -------
        ndarray, shape (n_slow, n_range), complex64
            Noise of variance ``(sigma * sigma_rf)**2`` in every bin.
        """
        white = rng.standard_normal((n_slow, 2 * self.n_white), np.float32)
        white *= np.float32(sigma_rf)
        mixed = (white.reshape(2 * n_slow, self.n_white) @ self.matrix).reshape(n_slow, 2, -1)
        out = np.empty((n_slow, self.matrix.shape[1]), np.complex64)
        out.real = mixed[:, 0]
        out.imag = mixed[:, 1]
        return out


@lru_cache(maxsize=16)
def noise_colour(axis: FastTimeAxis, pulse: Pulse | None = None) -> NoiseColour:
    """Return how noise on a baseband axis is made.

    Parameters
    ----------
    axis : FastTimeAxis
        Baseband; `sample_rate_hz` is the rate of the RF sampler, whatever the bin length.
    pulse : Pulse, optional
        The axis' own by default.

    Raises
    ------
    SceneError
        If the axis is RF, or states no sampling rate or no bandwidth.

    Notes
    -----
    The filter is 2 p / sum(p^2), so that an RF echo's amplitude is kept; white real samples
    of variance 1 leave it with variance 4 / sum(p^2), where sum(p^2) = s fs sqrt(pi). White
    numbers one s apart in place of all samples change no covariance by more than
    2 exp(-pi^2) = 1e-4 of the variance.
    """
    if axis.kind != "baseband" or not axis.sample_rate_hz > 0:
        msg = (
            f"noise is coloured on a baseband axis with a sampling rate; got kind "
            f"'{axis.kind}' and {axis.sample_rate_hz:g} Hz"
        )
        raise SceneError(msg)
    pulse = pulse or Pulse.of(axis)
    bins = np.arange(axis.n_range) * (axis.bin_length_m / pulse.sigma_m("rf"))
    white = np.arange(-_MARGIN_SIGMA, bins[-1] + _MARGIN_SIGMA + 1)
    response = np.exp(-0.5 * (bins - white[:, None]) ** 2)
    sigma = 2 / math.sqrt(pulse.sigma_s * axis.sample_rate_hz * math.sqrt(np.pi))
    # Half the variance to the real part and half to the imaginary one.
    scale = sigma / math.sqrt(2 * math.sqrt(np.pi))
    matrix = (scale * response).astype(np.float32)
    matrix.flags.writeable = False
    return NoiseColour(matrix, sigma)
