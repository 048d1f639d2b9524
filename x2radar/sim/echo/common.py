"""What the tiers share: the pulse, which echoes count at all, and the carrier's phase.

Every tier takes the same arguments. An echo that cannot reach a bin of the axis, or whose
amplitude is not above the floor, is left out before anything is computed for it; a
scatterer that never counts costs one comparison a frame.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.frame import FastTimeAxis, Samples
from x2radar.modules.x2 import SPEED_OF_LIGHT_MPS
from x2radar.sim.points import Array
from x2radar.sim.signal.pulse import pulse_sigma_s

Baseband = NDArray[np.complex64]

_FAINTEST = float(np.finfo(np.float32).tiny)  # below it, amplitudes are taken for zero

FINEST_DB = -100.0  # of the fast tiers; their rounding is -107 to -130 dB

# Echoes worked on at a time: their kernels then stay in a core's second-level cache (measured).
_BLOCK_ECHOES = 8192
_BLOCK_FRAMES = 1024


def echo_sigma_m(axis: FastTimeAxis, kind: str | None = None) -> float:
    """Return the standard deviation of an echo in range; SceneError without a bandwidth."""
    if not axis.bandwidth_hz > 0:
        msg = f"bandwidth_hz {axis.bandwidth_hz:g}: echoes need a pulse with a bandwidth"
        raise SceneError(msg)
    widening = math.sqrt(2) if (kind or axis.kind) == "baseband" else 1.0
    return widening * pulse_sigma_s(axis.bandwidth_hz) * SPEED_OF_LIGHT_MPS / 2


@dataclass(frozen=True, slots=True)
class Task:
    """Size, axis and allowed error of a block of frames that is to be computed."""

    n_slow: int
    n_points: int
    axis: FastTimeAxis
    error_db: float  # largest allowed

    @property
    def n_echoes(self) -> int:
        """Number of echoes: frames times scatterers."""
        return self.n_slow * self.n_points


def counted(
    range_m: Array, amplitude: Array, near_m: float, far_m: float, floor: float
) -> NDArray[np.bool_]:
    """Tell which echoes lie between two ranges and are stronger than the floor."""
    mask = range_m > near_m
    mask &= range_m < far_m
    mask &= np.abs(amplitude) > max(floor, _FAINTEST)
    return mask


def blocks(n_slow: int, n_points: int) -> Iterator[slice]:
    """Cut slow time into pieces that a core's cache holds."""
    size = max(1, min(_BLOCK_FRAMES, _BLOCK_ECHOES // max(1, n_points)))
    for first in range(0, n_slow, size):
        yield slice(first, min(first + size, n_slow))


def carrier_turns(range_m: Array, axis: FastTimeAxis) -> Array:
    """Return the carrier phase, sign * 2 R / lambda, in turns of -0.5 to 0.5, float64.

    The whole turns are taken off in float64: the error is 1e-16 of the number of wavelengths.
    """
    turns = range_m * (axis.phase_sign * 2 * axis.carrier_hz / SPEED_OF_LIGHT_MPS)
    turns -= np.rint(turns)
    return turns


def phasor(turns: Array, amplitude: Array) -> Baseband:
    """Return ``amplitude * exp(2j pi turns)`` in complex64, turns already reduced."""
    angle = turns.astype(np.float32)
    angle *= np.float32(2 * np.pi)
    out = np.empty(turns.shape, np.complex64)
    level = amplitude.astype(np.float32)
    np.multiply(np.cos(angle), level, out=out.real)
    np.multiply(np.sin(angle), level, out=out.imag)
    return out


@lru_cache(maxsize=16)
def carrier_wave(axis: FastTimeAxis) -> Baseband:
    """Return the carrier at every bin, shape (n_range,), that turns baseband into RF."""
    turns = -carrier_turns(axis.range_m, axis)
    wave = phasor(turns, np.ones_like(turns))
    wave.flags.writeable = False
    return wave


def empty(n_slow: int, axis: FastTimeAxis) -> Samples:
    """Return frames to be filled, in the axis' type."""
    shape = (n_slow, axis.n_range)
    if axis.kind == "rf":
        return np.empty(shape, np.float32)
    return np.empty(shape, np.complex64)
