"""Sampling jitter and gain noise: one delay and one gain per frame, fitted to the clutter.

Each frame is y_t = (1 + gain_t) b + delay_t b' + what moves, with b the mean frame and b' its
derivative by delay: in baseband -j 2 pi fc b, less the slope of the envelope, some 5 % of it for
an X2. What moves must stay: every cell is corrected with a fit to cells at least two pulse lengths
away; a cell's vote falls with what the fit leaves there (Cauchy weights, iterated); and the
correction is scaled by the share of it that the cell itself confirms over the dwell.
"""

import numpy as np
from numpy.typing import NDArray

from radard.dsp.clutter import Flags
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis

MAX_DELAY_S = 1e-12  # a common delay of more rms is no jitter (modules: 0.13 to 0.23 ps)
MAX_GAIN = 0.01  # a common gain of more rms is no gain noise (modules: up to 0.12 %): left alone
_ITERATIONS = 2  # of the weights
_TOLERANCE = 4.0  # of the Cauchy weights, in usual powers of a cell
_OUTLIER = 9.0  # six sigmas of a Gaussian, in medians of its magnitude
_CELL_PULSES = 2.0  # length of a cell, in pulses, so that neighbours hold tails
_CELL_BINS = 4  # and in bins, where the bandwidth is not known
_GUARD_CELLS = 2  # on either side, that have no say in a cell's correction
_MIN_FRAMES = 8
_TINY = 1e-30  # instead of zero, under rows from `sound_rows`
_UNIQUE = 1e-9  # least determinant, by its largest possible one

Array = NDArray[np.float64]


def take_out_jitter(rows: NDArray[np.complex64], usable: Flags, axis: FastTimeAxis) -> Array:
    """Take the clutter's common delay and gain out of rows from `sound_rows`, in place.

    Return both, shape (2, n_slow): the delay about the dwell's mean in radians of the carrier,
    later is positive, and the gain less one.
    """
    if np.count_nonzero(usable) < _MIN_FRAMES or axis.carrier_hz <= 0:
        return np.zeros((2, len(rows)))
    used = rows if usable.all() else rows[usable]
    mean = used.mean(axis=0, dtype=np.complex128)
    starts = _cell_starts(axis)
    columns = _columns(mean, axis, starts)
    parts = rows.view(np.float32)
    model = _Model(parts - mean.astype(np.complex64).view(np.float32), usable, columns, starts)
    theta, weight = model.fit_all()
    most = np.array([2 * np.pi * axis.carrier_hz * MAX_DELAY_S, MAX_GAIN])
    by_cell = model.fit_without_own(theta, weight, most)
    parts -= by_cell.transpose(1, 2, 0).reshape(len(rows), -1).astype(np.float32) @ columns
    return theta


def _cell_starts(axis: FastTimeAxis) -> NDArray[np.intp]:
    n_bins = _CELL_BINS
    if axis.bandwidth_hz > 0:
        length_m = _CELL_PULSES * SPEED_OF_LIGHT_MPS / (2 * axis.bandwidth_hz)
        n_bins = max(1, round(length_m / axis.bin_length_m))
    n_cells = max(1, round(axis.n_range / n_bins))
    return np.arange(n_cells) * axis.n_range // n_cells


def _columns(
    mean: NDArray[np.complex128], axis: FastTimeAxis, starts: NDArray[np.intp]
) -> NDArray[np.float32]:
    """Return both columns of every cell, shape (2 n_cells, 2 n_range), zero outside the cell."""
    # First the derivative by the carrier's turn in radians, then the clutter.
    bin_s = 2 * axis.bin_length_m / SPEED_OF_LIGHT_MPS
    turn = 2 * np.pi * axis.carrier_hz
    delay = axis.phase_sign * 1j * mean - _slope(mean) / (turn * bin_s)
    pair = np.stack([delay, mean]).astype(np.complex64).view(np.float32)
    cell = np.repeat(np.arange(len(starts)), 2 * np.diff(starts, append=len(mean)))
    out = np.zeros((len(starts), 2, 2 * len(mean)), np.float32)
    out[cell, :, np.arange(2 * len(mean))] = pair.T
    return out.reshape(-1, 2 * len(mean))


def _slope(row: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the derivative by the bin number, of fourth order but at the ends."""
    if len(row) < 2:
        return np.zeros_like(row)
    slope = np.empty_like(row)
    slope[1:-1] = (row[2:] - row[:-2]) / 2
    slope[0], slope[-1] = row[1] - row[0], row[-1] - row[-2]
    slope[2:-2] = (8 * (row[3:-1] - row[1:-3]) - (row[4:] - row[:-4])) / 12
    return slope


class _Model:
    """The sums over cells that all fits are made of; the frames are not touched again."""

    def __init__(
        self,
        moving: NDArray[np.float32],
        usable: Flags,
        columns: NDArray[np.float32],
        starts: NDArray[np.intp],
    ) -> None:
        n_cells = len(starts)
        products = (moving @ columns.T).reshape(-1, n_cells, 2).transpose(2, 0, 1)
        self._a, self._b = products.astype(np.float64, order="C")
        square = (moving * moving).astype(np.float64)
        self._power = np.add.reduceat(square, 2 * starts, axis=1)
        pair = columns.reshape(n_cells, 2, -1).astype(np.float64)
        normal = (pair @ pair.swapaxes(1, 2)).reshape(n_cells, 4)
        self._aa, self._ab, self._bb = normal.T[[0, 1, 3]]
        self._n_parts = np.diff(2 * starts, append=moving.shape[1])
        self._votes = usable[:, None].astype(np.float64)

    def fit_all(self) -> tuple[Array, Array]:
        """Return the fit to all cells, (2, n_slow), and the cells' weights, (n_slow, n_cells)."""
        aa, ab, bb, votes = self._aa, self._ab, self._bb, self._votes
        square = np.stack([aa, 2 * ab, bb])
        per_cell = np.ones(len(aa))
        left = self._power
        a_off = b_off = np.zeros(len(aa))
        theta, weight = np.zeros((2, len(votes))), votes
        for _ in range(_ITERATIONS):
            per_part = np.maximum(left / self._n_parts, _TINY)
            # The harmonic mean hardly sees the frames in which somebody crosses the cell.
            usual = votes.sum() / (votes.T @ (1 / per_part))
            weight = votes / (_TOLERANCE * usual + per_part)
            a_votes = weight * self._a
            b_votes = weight * self._b
            a_sum = a_votes @ per_cell - weight @ a_off
            b_sum = b_votes @ per_cell - weight @ b_off
            theta = _solve(weight @ aa, weight @ ab, weight @ bb, a_sum, b_sum)
            x, y = theta
            left = self._power + np.stack([x * x, x * y, y * y], axis=1) @ square
            left -= (2 * x)[:, None] * self._a
            left -= (2 * y)[:, None] * self._b
            # Who was in a cell for a while has moved its mean: the quiet frames are zero.
            x_mean, y_mean = theta @ weight
            total = weight.sum(axis=0)
            a_off = (a_votes.sum(axis=0) - x_mean * aa - y_mean * ab) / total
            b_off = (b_votes.sum(axis=0) - x_mean * ab - y_mean * bb) / total
        self._a -= a_off
        self._b -= b_off
        return theta, weight

    def fit_without_own(self, theta: Array, weight: Array, most: Array) -> Array:
        """Return what each cell is corrected by, (2, n_slow, n_cells)."""
        cell = np.arange(len(self._aa))
        apart = (np.abs(cell[:, None] - cell) > _GUARD_CELLS).astype(np.float64)
        # Sums over the others as they are, not the total less the own: nothing cancels.
        aa, ab, bb = (weight @ (apart * each[:, None]) for each in (self._aa, self._ab, self._bb))
        others = _solve(aa, ab, bb, (weight * self._a) @ apart, (weight * self._b) @ apart)
        # Jitter is never far over its usual size: what is was motion that outvoted the clutter.
        used = self._votes[:, 0] > 0
        n_used = np.count_nonzero(used)
        usual = np.median(np.abs(theta[:, used]), axis=1)
        most_here = _OUTLIER * usual[:, None, None]
        np.clip(others, -most_here, most_here, out=others)
        others -= others.sum(axis=1, keepdims=True) / n_used
        others *= self._votes
        # Squared, so that frames with somebody in the cell have no say.
        sure = weight * weight
        x, y = others
        square = others * others
        agreed = np.stack([(sure * x * self._a).sum(axis=0), (sure * y * self._b).sum(axis=0)])
        expected = (sure * square).sum(axis=1) * np.stack([self._aa, self._bb])
        trust = np.clip(agreed / np.where(expected > 0, expected, 1.0), 0, 1)
        trust[square.sum(axis=1) > n_used * most[:, None] ** 2] = 0
        others *= trust[:, None]
        return np.asarray(others)


def _solve(aa: Array, ab: Array, bb: Array, a: Array, b: Array) -> Array:
    """Solve symmetric 2 x 2 systems; zero where they have no unique solution."""
    both = aa * bb
    determinant = both - ab * ab
    inverse = np.where(determinant > _UNIQUE * both, 1 / np.maximum(determinant, _TINY), 0)
    return np.stack([(bb * a - ab * b) * inverse, (aa * b - ab * a) * inverse])
