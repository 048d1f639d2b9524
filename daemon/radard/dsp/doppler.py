"""Micro-Doppler spectrogram mu of a stream or a record, from Gram matrices (`radard.dsp.gram`).

mu[k, i] is the power at Doppler line k, summed over range, in the CPI of M frames from frame i on,
less its mean and with a taper (2.29-2.38).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radard.dsp.columns import ColumnStream, StepBuffer, whole
from radard.dsp.gram import Steps, gram, gram_map
from radard.errors import FeatureError
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS

_STEPS_AT_ONCE = 112  # four CPIs of 28 frames: a block that BLAS is fast with
# The map to mu amplifies what the Gram matrix was rounded by, as the square of the CPI:
# from 1e-6 at 28 frames to 2e-5 at 256 (measured), were the products not taken in float64.
_MAX_IN_SINGLE = 32


class StreamingDoppler(ColumnStream):
    """Spectrogram of a stream: CPIs of `n_cpi` frames, columns `stride` frames apart.

    Columns begin at frames 0, stride, 2 stride ... of the stream; zero Doppler is row n_cpi // 2,
    approaching above it. Relative error (norm) against the definition in float64
    (tests/dsp_reference.py): at most 1e-5 with static clutter of 0 to 140 dB under the motion, at
    signal amplitudes from 1e-38 to 1e37; however pushes are cut, 1e-6.
    """

    def __init__(self, n_cpi: int, *, stride: int = 1, n_keep: int = 512) -> None:
        if n_cpi < 2 or stride < 1:
            msg = f"a CPI of {n_cpi} frames and a stride of {stride}: at least 2 and 1 are needed"
            raise FeatureError(msg)
        self._map = gram_map(n_cpi)
        self._n_cpi, self._stride = n_cpi, stride
        # A block pays for the CPI before it as well; BLAS is at its best with whole vectors.
        n_steps = max(_STEPS_AT_ONCE, 2 * n_cpi)
        super().__init__(n_cpi, n_steps - n_steps % 16 - (n_cpi - 2), n_keep, n_cpi)

    def advance(self, steps: StepBuffer, n_new: int) -> int:
        """Make the columns that the newest `n_new` frames complete, by their Gram matrix."""
        n_frames, stride = steps.n_frames, self._stride
        earliest = max(0, n_frames - n_new - self._n_cpi + 1)
        first = -(-earliest // stride) * stride
        n_columns = (n_frames - self._n_cpi - first) // stride + 1
        if n_columns < 1:
            return 0
        rows: Steps = steps.rows(n_frames - first - 1)
        if self._n_cpi > _MAX_IN_SINGLE:
            rows = rows.astype(np.float64)
        columns = self._map.columns(gram(rows), n_columns, stride)
        self._store.append(columns, whole(steps.flags(n_frames - first), self._n_cpi, stride))
        return n_columns


def micro_doppler(frames: ArrayLike, n_cpi: int) -> NDArray[np.float32]:
    """Return mu of a whole record: `StreamingDoppler` fed once.

    `frames` are baseband, shape (n_slow, n_range), complex; one that is not finite counts as a
    repeat of the one before it. Shape (n_cpi, n_slow - n_cpi + 1), float32: linear power, zero
    Doppler in row n_cpi // 2, approaching above it; what float32 cannot hold becomes its largest
    number or zero. Raises FeatureError if `frames` is not 2-D or shorter than a CPI.
    """
    rows = np.asarray(frames)
    if rows.ndim != 2 or n_cpi < 2 or len(rows) < n_cpi:
        raise FeatureError(f"frames of shape {rows.shape} cannot fill a CPI of {n_cpi} frames")
    stream = StreamingDoppler(n_cpi, n_keep=len(rows) - n_cpi + 1)
    stream.push(rows)
    return np.minimum(stream.columns(), np.finfo(np.float32).max).astype(np.float32)


def doppler_hz(n_cpi: int, frame_rate_hz: float) -> NDArray[np.float64]:
    """Return the Doppler axis, shape (n_cpi,), ascending, zero at n_cpi // 2, in hertz."""
    return np.asarray(np.fft.fftshift(np.fft.fftfreq(n_cpi, 1 / frame_rate_hz)))


def velocity_mps(n_cpi: int, frame_rate_hz: float, carrier_hz: float) -> NDArray[np.float64]:
    """Return the radial velocity of every line of `doppler_hz`, approaching positive (2.25)."""
    return doppler_hz(n_cpi, frame_rate_hz) * (SPEED_OF_LIGHT_MPS / (2 * carrier_hz))
