"""Unfold: tell a velocity from its aliases by how fast what moves changes its range.

Each velocity gets the energy of all straight lines of its slope in the last half second of the
range picture; a band of the velocity picture fades by what speaks more for an alias c fp / (2 f)
apart.
"""

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]

_LAGS = (0, 2, 4, 6, 8)  # columns: half a second, in which a body hardly changes its speed
_SHARPNESS = 1.5  # strong cells count for more: the trunk, not the limbs
_NOTCH = 2  # rows beside zero that the removed mean takes along
_LINE_WEIGHT, _FADE = 2.0, 2.0  # of lines beside power, and of what is then less likely


class Unfolding:
    """Fade the aliases, `apart_mps` apart, in the velocity picture of one stream.

    `velocity_mps` are its rows, evenly spaced; 1 m/s crosses `cells_per_mps` of the `n_ranges`
    rows of the range picture from column to column; `span_db` is the velocity picture's.
    """

    def __init__(
        self,
        velocity_mps: NDArray[np.float64],
        apart_mps: float,
        n_ranges: int,
        cells_per_mps: float,
        span_db: float,
    ) -> None:
        moved = velocity_mps[:, None] * np.array(_LAGS) * cells_per_mps
        at = np.rint(np.arange(n_ranges) + moved.T[:, :, None]).astype(np.intp)
        # What lies outside is the row of zeros behind the last.
        self._lines = np.where((at >= 0) & (at < n_ranges), at, n_ranges)
        rows = np.arange(len(velocity_mps))
        step = velocity_mps[1] - velocity_mps[0]
        n_folds = int((velocity_mps[-1] - velocity_mps[0]) / apart_mps)
        self._folds = [rows + k * apart_mps / step for k in range(-n_folds, n_folds + 1) if k]
        self._bytes_per_db = 255 / span_db
        self._trail = np.zeros((n_ranges + 1, _LAGS[-1]), np.float32)

    def restart(self) -> None:
        """Forget the columns so far."""
        self._trail[:] = 0

    def unfold(self, velocities: Bytes, ranges: Bytes) -> Bytes:
        """Return new columns of the velocity picture, given those of the range picture."""
        n = velocities.shape[1]
        new = np.vstack([(ranges / np.float32(255)) ** _SHARPNESS, np.zeros((1, n), np.float32)])
        seen = np.hstack([self._trail, new.astype(np.float32)])
        self._trail = seen[:, -_LAGS[-1] :]
        lines = sum(
            seen[at, _LAGS[-1] - lag : _LAGS[-1] - lag + n]
            for at, lag in zip(self._lines, _LAGS, strict=True)
        )
        energy = np.einsum("vrn,vrn->vn", lines, lines)
        # As strong as its neighbours: who stands still has a notch at zero, not at its aliases.
        padded = np.pad(velocities, ((_NOTCH, _NOTCH), (0, 0)))
        near = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NOTCH + 1, axis=0)
        likely_db = near.max(axis=2) / self._bytes_per_db + 10 * _LINE_WEIGHT * np.log10(
            np.maximum(energy, 1e-9)
        )
        best_db = likely_db.copy()
        rows = np.arange(len(velocities))
        for fold in self._folds:
            for k in range(n):
                other = np.interp(fold, rows, likely_db[:, k], left=-np.inf, right=-np.inf)
                np.maximum(best_db[:, k], other, out=best_db[:, k])
        faded = velocities - _FADE * self._bytes_per_db * (best_db - likely_db)
        return np.asarray(np.clip(faded, 0, 255), np.uint8)
