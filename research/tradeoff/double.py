"""Range-time and velocity-time maps in float64, hop by hop like the daemon's in float32."""

from collections.abc import Mapping

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from radard.dsp.gram import centring, gaussian_taper
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.velocity import VelocityTransform
from radard.dsp.wideband import range_dft, velocity_operator
from x2radar.frame import FastTimeAxis

Steps = NDArray[np.complex128]
_FLATTEN = 1.5  # as the velocity map's
_N_KEPT = 400  # columns: two dwells at 200 Hz


class DoubleMaps:
    """All maps of a chain.

    Parameters
    ----------
    ranges : RangeTimeMap
        Whose cells are used.
    transforms : mapping of str to VelocityTransform
        Whose grids are used, by picture.
    axis, frame_rate_hz
        As of the chain.
    n_cpi : int
        Frames in a CPI of the range map.

    Attributes
    ----------
    made : dict of str to DoubleVelocity or DoubleRanges
        By picture.
    """

    def __init__(
        self,
        ranges: RangeTimeMap,
        transforms: Mapping[str, VelocityTransform],
        axis: FastTimeAxis,
        frame_rate_hz: float,
        n_cpi: int,
    ) -> None:
        self.made: dict[str, DoubleVelocity | DoubleRanges] = {
            name: DoubleVelocity(transform, axis, frame_rate_hz)
            for name, transform in transforms.items()
        }
        self.made["range_time"] = DoubleRanges(ranges, axis, n_cpi)
        self._last: Steps | None = None

    def push(self, frames: NDArray[np.complex64]) -> None:
        """Add frames; columns of the last two dwells or so are kept."""
        rows = frames.astype(np.complex128)
        before = rows[:1] if self._last is None else self._last
        steps = np.diff(rows, axis=0, prepend=before)
        self._last = rows[-1:]
        for each in self.made.values():
            each.push(steps)


class DoubleRanges:
    """A range-time map.

    Parameters
    ----------
    ranges : RangeTimeMap
        Whose cells are used.
    axis : FastTimeAxis
        Of the frames.
    n_cpi : int
        Frames in a CPI.
    """

    stride = 1

    def __init__(self, ranges: RangeTimeMap, axis: FastTimeAxis, n_cpi: int) -> None:
        self._n_cpi = n_cpi
        self._share = ranges.weights[: axis.n_range].astype(np.float64)
        self._middle = centring(n_cpi)[n_cpi // 2]
        self._steps: Steps = np.zeros((0, axis.n_range), np.complex128)
        self._n_seen = 0
        self._columns = np.zeros((len(ranges.range_m), 0))

    def columns(self) -> NDArray[np.float64]:
        """Return the columns that are kept, shape (n_cells, n)."""
        return self._columns

    def push(self, steps: Steps) -> None:
        """Add steps from frame to frame."""
        n_old = self._n_seen
        self._n_seen += len(steps)
        self._steps = np.concatenate([self._steps, steps])[-(len(steps) + self._n_cpi) :]
        n = self._n_seen - self._n_cpi - max(0, n_old - self._n_cpi + 1) + 1
        if n < 1:
            return
        rows = self._steps[len(self._steps) - (n + self._n_cpi - 2) :]
        residual = np.zeros((n, len(rows)))
        for i in range(n):
            residual[i, i : i + self._n_cpi - 1] = self._middle
        z = residual @ rows
        power = (z.real**2 + z.imag**2) @ self._share
        self._columns = np.concatenate([self._columns, power.T], axis=1)[:, -_N_KEPT:]


class DoubleVelocity:
    """A velocity-time map."""

    def __init__(
        self, transform: VelocityTransform, axis: FastTimeAxis, frame_rate_hz: float
    ) -> None:
        self.stride, self._n_cpi = transform.stride, transform.n_cpi
        self.column_rate_hz = transform.column_rate_hz
        self._dft = range_dft(axis, transform.frequency_hz, _FLATTEN)
        self._operator = velocity_operator(
            transform.frequency_hz,
            transform.velocity_mps,
            frame_rate_hz,
            gaussian_taper(self._n_cpi),
        )
        self._spectra: Steps = np.zeros((0, len(transform.frequency_hz)), np.complex128)
        self._n_seen = 0
        self._columns = np.zeros((len(transform.velocity_mps), 0))

    def columns(self) -> NDArray[np.float64]:
        """Return the columns that are kept, shape (n_velocity, n)."""
        return self._columns

    def push(self, steps: Steps) -> None:
        """Add steps from frame to frame."""
        n_old = self._n_seen
        self._n_seen += len(steps)
        spectra = np.concatenate([self._spectra, steps @ self._dft])
        self._spectra = spectra[-(len(steps) + self._n_cpi + self.stride) :]
        first = -(-max(0, n_old - self._n_cpi + 1) // self.stride) * self.stride
        n = (self._n_seen - self._n_cpi - first) // self.stride + 1
        if n < 1:
            return
        rows = np.ascontiguousarray(self._spectra[len(self._spectra) - (self._n_seen - first) :].T)
        n_freq, width = len(rows), self._n_cpi - 1
        s0, s1 = rows.strides
        windows = as_strided(rows[:, 1:], (n_freq, width, n), (s0, s1, self.stride * s1)).copy()
        lines = self._operator @ windows
        power = (lines.real**2 + lines.imag**2).sum(axis=0)
        self._columns = np.concatenate([self._columns, power], axis=1)[:, -_N_KEPT:]
