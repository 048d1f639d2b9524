"""Micro-Doppler spectrogram mu of a stream or a record, as a linear map of Gram matrices of steps.

mu[k, i] is the power at Doppler line k, summed over range, in the CPI of M frames from frame i on,
less its mean and with a taper (2.29-2.38).
With A = DFT diag(taper) (I - 11^T / M) and y a CPI, over range bins n::

    mu_k = sum_n |sum_m A[k, m] y[m, n]|^2 = (A C A^H)[k, k],    C = Y Y^H

A takes constants away, hence y may be a running sum of steps d: with S the summation, mu =
diag(B G B^H), B = A S, G = D D^H, and static clutter has cancelled before anything is squared. So
mu is one real matrix times the (M - 1)^2 real numbers of the Hermitian G, which is stored as one
real square Q: Re G on and below the diagonal, Im G above it.
"""

from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import ArrayLike, NDArray

from radard.dsp.columns import ColumnStream, Reals, StepBuffer, whole
from radard.errors import FeatureError
from x2radar.frame import SPEED_OF_LIGHT_MPS

Steps = NDArray[np.float32] | NDArray[np.float64]

_TAPER_WIDTH = 2 / 4.29193  # one tenth at both ends (2.31)
_MAX_STORED = 128  # frames of a CPI: 16 MiB of map
# Squares of rows within these energies neither overflow float32 nor lose digits in it.
MIN_ENERGY, MAX_ENERGY = 1e-25, 1e30
_STEPS_AT_ONCE = 112  # four CPIs of 28 frames: a block that BLAS is fast with
# The map to mu amplifies what the Gram matrix was rounded by, as the square of the CPI:
# from 1e-6 at 28 frames to 2e-5 at 256 (measured), were the products not taken in float64.
_MAX_IN_SINGLE = 32


def gaussian_taper(n_cpi: int) -> Reals:
    """Return the thesis' taper, shape (n_cpi,): Gaussian, one tenth at both ends (2.31)."""
    centre = (n_cpi - 1) / 2
    x = (np.arange(n_cpi) - centre) / (_TAPER_WIDTH * centre)
    return np.asarray(np.exp(-0.5 * x**2))


def step_operator(taper: Reals) -> NDArray[np.complex128]:
    """Return B, steps within a CPI to ascending Doppler lines, (n_cpi, n_cpi - 1), complex128."""
    n_cpi = len(taper)
    k = np.arange(n_cpi)
    dft = np.exp(-2j * np.pi * ((np.outer(k, k) % n_cpi) / n_cpi))
    return np.asarray(np.fft.fftshift((dft * taper) @ centring(n_cpi), axes=0))


def centring(n_cpi: int) -> Reals:
    """Return the map from steps to frames less their mean, shape (n_cpi, n_cpi - 1)."""
    summation = np.tri(n_cpi, n_cpi - 1, -1)
    return np.asarray(summation - summation.mean(axis=0))


class GramMap:
    """From Gram matrices of steps to columns of the spectrogram."""

    def __init__(self, n_cpi: int) -> None:
        self.n_cpi = n_cpi
        self._operator = step_operator(gaussian_taper(n_cpi))
        rows = [self._row(a) for a in range(n_cpi - 1 if n_cpi <= _MAX_STORED else 0)]
        self._stored: Reals | None = np.concatenate(rows, axis=1).T.copy() if rows else None

    def _row(self, a: int) -> Reals:
        """Return the weights of row `a` of Q, shape (n_cpi, n_cpi - 1)."""
        b = np.arange(self.n_cpi - 1)
        pairs = self._operator[:, a, None] * self._operator.conj()
        return np.where(b <= a, np.where(b == a, 1.0, 2.0) * pairs.real, -2.0 * pairs.imag)

    def columns(self, gram: Reals, n: int, stride: int = 1) -> Reals:
        """Return `n` columns, shape (n, n_cpi), float64, `stride` steps apart, of Q, `gram`."""
        width = self.n_cpi - 1
        s0, s1 = gram.strides
        shape, strides = (n, width, width), (stride * (s0 + s1), s0, s1)
        squares = as_strided(gram, shape, strides, writeable=False)
        if self._stored is not None:
            mu = squares.reshape(n, -1) @ self._stored
        else:
            mu = np.zeros((n, self.n_cpi))
            for a in range(width):
                mu += squares[:, a] @ self._row(a).T
        return np.asarray(np.maximum(mu, 0, out=mu))


gram_map = lru_cache(maxsize=8)(GramMap)
"""The map for a CPI; those in use are kept, as they take long to make."""


def gram(rows: Steps) -> Reals:
    """Return Q, shape (n_steps, n_steps), float64, of steps summed over range.

    `rows` are planar steps, shape (n_steps, 2 n_range), all finite. Products are summed in the
    type of the rows; rows so strong or weak that float32 cannot hold their squares are scaled by
    powers of two first, each by its own.
    """
    n_range = rows.shape[1] // 2
    real, imag = rows[:, :n_range], rows[:, n_range:]
    q = _products(real, imag)
    energy = q.diagonal()
    if (energy > MIN_ENERGY).all() and (energy < MAX_ENERGY).all():
        return q
    peak = np.maximum(np.abs(real).max(axis=1), np.abs(imag).max(axis=1))
    exponent = np.frexp(peak)[1]
    down = -exponent[:, None]
    q = _products(np.ldexp(real, down), np.ldexp(imag, down))
    return np.asarray(np.ldexp(q, exponent[:, None] + exponent))


def _products(real: Steps, imag: Steps) -> Reals:
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        even = real @ real.T
        even += imag @ imag.T
        cross = imag @ real.T
        odd = cross - cross.T
        # More exact than a matrix product, whose long chains of additions round squares of whole
        # quanta (ADC samples, or anything under strong clutter) all the same way: an odd number's
        # square is 1 modulo 8. The map to mu amplifies what all the diagonal has in common.
        energy = np.vecdot(real, real) + np.vecdot(imag, imag)
    q = even.astype(np.float64)
    np.copyto(q, odd, where=~np.tri(len(q), dtype=np.bool_))
    np.fill_diagonal(q, energy)
    return q


class StreamingDoppler(ColumnStream):
    """Spectrogram of a stream: CPIs of `n_cpi` frames, columns `stride` frames apart.

    Columns begin at frames 0, stride, 2 stride ... of the stream; zero Doppler is row n_cpi // 2,
    approaching above it. Amplitudes: 1e-38 to 1e37.
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
