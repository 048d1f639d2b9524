"""What moves: power left after clutter removal, and the noise it must stand out from."""

import numpy as np
from numpy.typing import NDArray

from radard.errors import FeatureError

_LOW_QUANTILE = 0.1
# An exponential variable's quantile q lies at -ln(1 - q) of its mean.
_TO_MEAN = -1 / np.log1p(-_LOW_QUANTILE)


def residual_power(
    frames: NDArray[np.complex64], valid: NDArray[np.bool_], n_cpi: int
) -> NDArray[np.float64]:
    """Return the residual power of every range bin, CPI by CPI.

    Clutter is the mean over one CPI, as in the spectrogram (2.29), so that slow drift of
    the room counts as clutter. The record is cut into whole CPIs from its end.

    Parameters
    ----------
    frames : ndarray, shape (n_slow, n_range), complex64
        Baseband frames.
    valid : ndarray, shape (n_slow,), bool
        False for frames that were lost; a CPI with one of them is left out.
    n_cpi : int
        Frames in one CPI, at least 2.

    Returns
    -------
    ndarray, shape (n_whole_cpis, n_range), float64
        Mean power per frame in sample units squared, unbiased for noise; no rows when no
        CPI is whole.

    Raises
    ------
    FeatureError
        If the record is shorter than a CPI.
    """
    n_blocks = len(frames) // n_cpi
    if n_blocks == 0 or n_cpi < 2:
        msg = f"{len(frames)} frames cannot fill a CPI of {n_cpi}"
        raise FeatureError(msg)
    used = n_blocks * n_cpi
    whole = valid[-used:].reshape(n_blocks, n_cpi).all(axis=1)
    cpis = frames[-used:].reshape(n_blocks, n_cpi, -1)[whole]
    # Centred on a frame of its own first: static clutter must be gone before the squares.
    centred = cpis - cpis[:, :1]
    centred -= centred.mean(axis=1, keepdims=True)
    parts = centred.view(np.float32).reshape(*centred.shape, 2)
    power = np.einsum("bmnc,bmnc->bn", parts, parts, dtype=np.float64)
    return np.asarray(power / (n_cpi - 1))


def centre_spread_m(
    power: NDArray[np.float64], noise: float, range_m: NDArray[np.float64]
) -> float:
    """Return how far the residual power's centre wanders within the dwell, in metres.

    Parameters
    ----------
    power : ndarray, shape (n_cpis, n_range), float64
        From `residual_power`.
    noise : float
        From `noise_power`; cells below four times that do not count.
    range_m : ndarray, shape (n_range,), float64
        Range axis, in metres.

    Returns
    -------
    float
        Distance between the nearest and the farthest centre of power, over the CPIs with at
        least a tenth of the strongest one's power; 0 when nothing stands out.
    """
    weight = np.maximum(power - 4 * noise, 0)
    total = weight.sum(axis=1)
    strong = total > 0.1 * total.max(initial=0)
    if not strong.any():
        return 0.0
    return float(np.ptp((weight[strong] @ range_m) / total[strong]))


def noise_power(frames: NDArray[np.complex64], valid: NDArray[np.bool_]) -> float:
    """Return the receiver's noise power per bin and frame, from the frames alone.

    Second differences along slow time leave noise (six times its power) and little of
    anything slow. Their low quantile over all bins and frames is hardly moved by a target,
    which fills few of these cells; for noise alone it is unbiased.

    Parameters
    ----------
    frames : ndarray, shape (n_slow, n_range), complex64
        Baseband frames.
    valid : ndarray, shape (n_slow,), bool
        False for frames that were lost.

    Returns
    -------
    float
        Mean noise power in sample units squared; NaN when no three whole frames follow
        each other. With a target in every cell it is too high by at most the target.
    """
    good = valid[2:] & valid[1:-1] & valid[:-2]
    if not good.any():
        return float("nan")
    second = (frames[2:] - frames[1:-1]) - (frames[1:-1] - frames[:-2])
    cells = second[good]
    power = cells.real**2 + cells.imag**2
    return float(np.quantile(power, _LOW_QUANTILE) * _TO_MEAN / 6)
