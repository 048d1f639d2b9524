"""Gates that follow tracks in range, so that features see one body at a time."""

import numpy as np
from numpy.typing import NDArray


def range_gates(
    paths_m: NDArray[np.float64],
    range_m: NDArray[np.float64],
    *,
    half_width_m: float = 0.5,
    taper_m: float = 0.2,
) -> NDArray[np.float32]:
    """Return for every track how much of each cell of a dwell is its own.

    `paths_m` is the range of every track at every frame, shape (n_tracks, n_slow), `range_m` the
    range axis of the dwell. `half_width_m` from a track its gate's weight is one half; the edges
    are raised cosines of length `taper_m`.

    Weights of amplitude, 0 to 1, shape (n_tracks, n_slow, n_range), float32. Overlapping gates
    hand over in the middle between the tracks, over the same length; the weights of a cell sum to
    at most one, to 1e-6. Multiply frames that are free of static clutter: a moving gate would
    modulate what stands still.
    """
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
