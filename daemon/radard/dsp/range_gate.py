"""Gates that follow tracks in range, so that features see one body at a time."""

import numpy as np
from numpy.typing import NDArray

from radard.errors import FeatureError


def range_gates(
    paths_m: NDArray[np.float64],
    range_m: NDArray[np.float64],
    *,
    half_width_m: float = 0.5,
    taper_m: float = 0.2,
) -> NDArray[np.float32]:
    """Return for every track how much of each cell of a dwell is its own.

    Parameters
    ----------
    paths_m : ndarray, shape (n_tracks, n_slow), float64
        Range of every track at every frame (`Track.path_m`).
    range_m : ndarray, shape (n_range,), float64
        Range axis of the dwell.
    half_width_m, taper_m : float
        Distance from a track at which its gate's weight is one half, and length of the gate's
        raised-cosine edges.

    Returns
    -------
    ndarray, shape (n_tracks, n_slow, n_range), float32
        Weights of amplitude, 0 to 1. Overlapping gates hand over in the middle between the
        tracks, over the same length; the weights of a cell sum to at most one, to 1e-6.
        Multiply frames that are free of static clutter: a moving gate would modulate what
        stands still.

    Raises
    ------
    FeatureError
        If the paths are not 2-D or a width is not positive.
    """
    if paths_m.ndim != 2 or half_width_m <= 0 or taper_m <= 0:
        msg = f"range gates need 2-D paths and positive widths, got {paths_m.shape}"
        raise FeatureError(msg)
    paths = paths_m.astype(np.float32)
    off = np.abs(range_m.astype(np.float32) - paths[..., None])
    gates = _edge((half_width_m - off) / taper_m)
    for i in range(len(paths)):
        for j in range(i):
            if np.any(np.abs(paths[i] - paths[j]) < 2 * half_width_m + taper_m):
                share = _edge((off[j] - off[i]) / (2 * taper_m))
                gates[i] *= share
                gates[j] *= 1 - share
    return gates


def _edge(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the raised cosine that rises from 0 at -1/2 to 1 at 1/2."""
    return np.asarray(0.5 + 0.5 * np.sin(np.pi * np.clip(x, -0.5, 0.5)), np.float32)
