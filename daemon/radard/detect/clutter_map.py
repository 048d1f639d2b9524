"""ClutterMap: the room as it is when nothing moves, learned online; and its removal."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from radard.dsp import clutter
from radard.dsp.jitter import take_out_jitter
from radard.stream.ring import Dwell

_MEMORY_S, _LONGEST_S = 20.0, 600.0
_STILL = 2.0  # power over the noise up to which a bin is still


class ClutterMap:
    """Mean of every range bin, with a memory that is longer where something moves.

    Each block of frames counts with a weight s per bin, 1 where the bin is still and falling
    with its power over the noise to `_MEMORY_S` over `_LONGEST_S` where something moves::

        b += s n / (N + s n) (mean of the block - b),   N = min(N + s n, memory)

    So somebody in the room enters the map at most at the rate of `_LONGEST_S`.
    """

    def __init__(self, n_range: int, frame_rate_hz: float) -> None:
        self._memory = _MEMORY_S * frame_rate_hz
        self.mean = np.zeros(n_range, np.complex128)
        """Clutter of every bin in sample units, ndarray, shape (n_range,), complex128."""
        self._count = np.zeros(n_range)

    def update(
        self, block_mean: NDArray[np.complex128], n: int, motion: NDArray[np.float64]
    ) -> None:
        """Learn from `n` frames: their mean and their power over the noise, shape (n_range,)."""
        weight = n * np.clip(_STILL / np.maximum(motion, _STILL), _MEMORY_S / _LONGEST_S, 1.0)
        self._count += weight
        self.mean += (weight / self._count) * (block_mean - self.mean)
        np.minimum(self._count, self._memory, out=self._count)


class ClutterRemover:
    """Take spikes, jitter and clutter out of every dwell: what is left is motion and noise."""

    def __init__(self) -> None:
        self._map: ClutterMap | None = None
        self._t_s = 0.0

    def remove(self, dwell: Dwell) -> Dwell:
        """Return the dwell without its clutter, in frames of its own and the same unit.

        Spikes and frames that are not finite are marked as lost in `valid` and `n_lost`, and every
        lost frame repeats the one before; `longest_gap_s` stays that of the stream. The map is one
        frame that is taken off all frames alike, so Doppler is what it was.
        """
        rows, usable, scale = clutter.sound_rows(dwell.frames, dwell.valid)
        usable &= ~clutter.spike_rows(rows, usable)
        take_out_jitter(rows, usable, dwell.axis)
        n_new = len(rows)
        if self._map is None:
            self._map = ClutterMap(rows.shape[1], dwell.frame_rate_hz)
        else:
            n_new = min(n_new, round((dwell.t_s - self._t_s) * dwell.frame_rate_hz))
        self._t_s = dwell.t_s
        if n_new > 0:
            _learn(self._map, rows[-n_new:], usable[-n_new:], scale)
        rows -= (self._map.mean / scale).astype(np.complex64)
        if not usable.all():
            clutter.repeat_usable(rows, usable, ~usable)
        parts = rows.view(np.float32)
        parts *= np.float32(scale)
        n_lost = int(np.count_nonzero(~usable))
        return replace(dwell, frames=rows, valid=usable, n_lost=n_lost)


def _learn(
    room: ClutterMap, rows: NDArray[np.complex64], usable: clutter.Flags, scale: float
) -> None:
    good = rows if usable.all() else rows[usable]
    if len(good) == 0:
        return
    mean = good.mean(axis=0, dtype=np.complex128)
    moving = (good - mean.astype(np.complex64)).view(np.float32)
    np.square(moving, out=moving)
    power = moving.mean(axis=0, dtype=np.float64).reshape(-1, 2).sum(axis=1)
    noise = clutter.noise_of(clutter.second_differences(rows, usable))
    motion = power / noise if noise > 0 else np.zeros(len(power))
    room.update(mean * scale, len(good), motion)
