"""The slow-time Gram matrix of steps, and the spectrogram as a linear map of it.

With A = DFT diag(taper) (I - 11^T / M), the power of a CPI y of M frames at Doppler line k,
summed over range bins n, is a quadratic form::

    mu_k = sum_n |sum_m A[k, m] y[m, n]|^2 = (A C A^H)[k, k],    C = Y Y^H

A takes constants away, hence y may be a running sum of steps d: with S the summation, mu =
diag(B G B^H), B = A S, G = D D^H, and static clutter has cancelled before anything is squared. So
mu is one real matrix times the (M - 1)^2 real numbers of the Hermitian G, which is stored as one
real square Q: Re G on and below the diagonal, Im G above it.
"""

from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Steps = NDArray[np.float32] | NDArray[np.float64]

_TAPER_WIDTH = 2 / 4.29193  # one tenth at both ends (2.31)
_MAX_STORED = 128  # frames of a CPI: 16 MiB of map
# Squares of rows within these energies neither overflow float32 nor lose digits in it.
_LOW, _HIGH = 1e-25, 1e30


def gaussian_taper(n_cpi: int) -> Reals:
    """Return the thesis' taper, shape (n_cpi,): Gaussian, one tenth at both ends (2.31)."""
    centre = (n_cpi - 1) / 2
    if centre == 0:
        return np.ones(1)
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
    if (energy > _LOW).all() and (energy < _HIGH).all():
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
