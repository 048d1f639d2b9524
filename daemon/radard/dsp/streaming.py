"""Micro-Doppler of a stream: new frames in, new columns out.

Per column only the last CPI's steps and their Gram matrix are kept. Both hold differences
and products of neighbouring frames, never a running sum, so nothing drifts: the millionth
column is as exact as the first.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from radard.dsp.columns import ColumnStream
from radard.dsp.gram import Reals, Steps, checked_taper, extend, gram, gram_map
from radard.dsp.steps import StepBuffer, whole
from radard.errors import FeatureError

_STEPS_AT_ONCE = 112  # chosen: four CPIs of 28 frames
# The map to mu amplifies what the Gram matrix was rounded by, as the square of the CPI:
# from 1e-6 at 28 frames to 2e-5 at 256 (measured), were the products not taken in float64.
_LONGEST_IN_SINGLE = 32


class StreamingDoppler(ColumnStream):
    """Spectrogram of a stream.

    Parameters
    ----------
    n_cpi : int
        Frames in one CPI, at least 2.
    taper : ndarray, shape (n_cpi,), optional
        Weight of every frame of a CPI; the thesis' Gaussian when not given.
    bands : sequence of (int, int), optional
        Range bands to be summed apart (first bin, bin behind the last), overlapping or not;
        one band of all bins when not given.
    stride : int
        Frames from one column to the next; columns begin at frames 0, stride, 2 stride ...
        of the stream, however it is cut into pushes.
    n_keep : int
        Columns that can be asked for.

    Raises
    ------
    FeatureError
        If a setting makes no sense.

    Notes
    -----
    One new frame costs one matrix-vector product with the last CPI's steps; a block of
    frames, one matrix product, which is several times cheaper per frame. Relative error (norm)
    against the definition in float64 (tests/dsp_reference.py): at most 1e-5 with static clutter
    of 0 to 140 dB under the motion, at signal amplitudes from 1e-38 to 1e37 and at any time of
    the stream. One push of all frames and any cut into smaller ones agree to 1e-6.
    """

    def __init__(
        self,
        n_cpi: int,
        *,
        taper: NDArray[np.floating] | None = None,
        bands: Sequence[tuple[int, int]] | None = None,
        stride: int = 1,
        n_keep: int = 512,
    ) -> None:
        if stride < 1:
            msg = f"stride {stride}: columns must lie at least one frame apart"
            raise FeatureError(msg)
        self._map = gram_map(checked_taper(n_cpi, taper))
        self._n_cpi = n_cpi
        self._bands = None if bands is None else tuple(bands)
        self._stride = stride
        super().__init__(n_cpi, _block_length(n_cpi), n_keep, n_cpi)
        self._kept: list[Reals] = []

    def restart(self) -> None:
        """See `ColumnStream`."""
        super().restart()
        self._kept = []

    def columns(self, n: int | None = None) -> Reals:
        """See `ColumnStream`; with bands, shape (n_bands, n_cpi, n).

        Zero Doppler is row n_cpi // 2, approaching above it. Columns that a lost frame touches
        are finite.
        """
        columns, _ = self._store.last(n)
        if columns.ndim < 3:
            return np.zeros((self._n_cpi, 0))
        by_band = columns.transpose(1, 2, 0)
        return by_band.copy() if self._bands is not None else by_band[0].copy()

    def advance(self, steps: StepBuffer, n_new: int) -> int:
        """See `ColumnStream`."""
        n_frames, stride = steps.n_frames, self._stride
        earliest = max(0, n_frames - n_new - self._n_cpi + 1)
        first = -(-earliest // stride) * stride
        n_columns = (n_frames - self._n_cpi - first) // stride + 1
        if n_columns < 1:
            self._kept = []
            return 0
        rows: Steps = steps.rows(n_frames - first - 1)
        if self._n_cpi > _LONGEST_IN_SINGLE:
            rows = rows.astype(np.float64)
        bands = self._bands_of(steps.n_range)
        columns = np.empty((n_columns, len(bands), self._n_cpi))
        for b, band in enumerate(bands):
            q = self._gram(rows, b, band, n_new)
            columns[:, b] = self._map.columns(q, n_columns, stride)
        flags = steps.flags(n_frames - first)
        good = np.ones(n_columns, np.bool_)
        if not flags.all():
            good = whole(flags, self._n_cpi, stride)
        self._store.append(columns, good)
        return n_columns

    def _gram(self, rows: Steps, b: int, band: tuple[int, int], n_new: int) -> Reals:
        """Return Q of `rows`, from the last push's where that is cheaper; keep its end."""
        n_kept = self._n_cpi - 2
        q = None
        if n_new == 1 and b < len(self._kept) and len(self._kept[b]) == len(rows) - 1:
            q = extend(self._kept[b], rows, band)
        if q is None:
            q = gram(rows, band)
        end = q[len(q) - n_kept :, len(q) - n_kept :]
        if b < len(self._kept):
            self._kept[b] = end
        else:
            self._kept.append(end)
        return q

    def _bands_of(self, n_range: int) -> tuple[tuple[int, int], ...]:
        bands = self._bands if self._bands is not None else ((0, n_range),)
        if not bands or not all(0 <= first < stop <= n_range for first, stop in bands):
            msg = f"range bands {bands}: each must hold bins of 0 to {n_range}"
            raise FeatureError(msg)
        return bands


def _block_length(n_cpi: int) -> int:
    """Return how many frames are best taken at once."""
    # A block pays for the Gram matrix of its own steps and of the CPI before them, so it
    # should be no shorter than a CPI; BLAS is at its best with sizes of whole vectors.
    n_steps = max(_STEPS_AT_ONCE, 2 * n_cpi)
    return n_steps - n_steps % 16 - (n_cpi - 2)
