"""Maps as networks see them, in decibels; velocity-time ones with CPIs of several lengths.

What is shown is shape, not strength: every column of time is set against its own maximum, or
against a level under the dwell's maximum where it is weaker than that.

A CPI of T seconds resolves c / (2 f T): in 0.2 s 0.1 m/s, and the swing of a leg is seen as it
goes; in 0.6 s 0.04 m/s, which parts slow limbs; in 1.5 s 0.014 m/s, breath and sway from panting.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.dsp.range_time import time_cells
from radard.dsp.velocity import VelocityTransform
from radard.stream.ring import Dwell
from x2radar.frame import SPEED_OF_LIGHT_MPS

WEAKEST_COLUMN_DB = 25.0  # weaker columns stay dark: the maps' own depth
Map = NDArray[np.float32]
_MAX_SHARE = 0.75  # of a dwell, for a CPI: the rest is what its columns move over


def shown(power: NDArray[np.float64], valid: NDArray[np.bool_], depth_db: float) -> Map:
    """Return a map of power as a picture with values from 0 to 1, same shape, float32.

    `power` is linear, shape (n_rows, n_cells); columns that are not `valid` are 0 in the result. 1
    is the reference, 0 `depth_db` under it and less. All zero where there is no power, or none
    that is finite. Error at most 1e-6 against extended precision, for powers from 1e-320 to 1e300.
    """
    out = np.zeros(power.shape, np.float32)
    known = np.where(valid, power, 0.0)
    top = float(known.max(initial=0.0))
    if not 0 < top < np.inf:
        return out
    share = known / top
    column = np.maximum(share.max(axis=0), 10 ** (-WEAKEST_COLUMN_DB / 10))
    level_db = 10 * np.log10(np.maximum(share / column, 1e-12))
    np.clip(1 + level_db / depth_db, 0, 1, out=out, casting="unsafe")
    out[:, ~valid] = 0
    return out


def busiest_rows(power: NDArray[np.float64], n_rows: int) -> NDArray[np.float64]:
    """Return a copy of the `n_rows` neighbouring rows in which most moves, the nearest of equals.

    By the mean of each row's share of its column, so one strong moment does not decide. A map with
    fewer rows is filled up with empty ones behind its last.
    """
    n_all = len(power)
    if n_all <= n_rows:
        return np.concatenate([power, np.zeros((n_rows - n_all, power.shape[1]))])
    peak = power.max(axis=0, initial=0.0)
    share = np.divide(power, peak, out=np.zeros_like(power), where=peak > 0).mean(axis=1)
    sums = np.concatenate([[0.0], np.cumsum(share)])
    first = int(np.argmax(sums[n_rows:] - sums[:-n_rows]))
    return power[first : first + n_rows].copy()


@dataclass(frozen=True, slots=True, kw_only=True)
class VelocityGrid:
    """CPI and axes of one velocity-time map."""

    cpi_s: float  # length of the CPI at the carrier `carrier_hz`
    # At another carrier the CPI lasts in proportion to the wavelength, so that every radar
    # resolves the same velocity. 0: the same length for all.
    carrier_hz: float
    least_frames: int  # of a CPI
    max_mps: float  # reach of the rows
    step_mps: float  # and their spacing
    cell_s: float  # time cell
    n_cells: int  # columns, the last of which ends with the dwell
    depth_db: float  # what is shown, see `shown`
    # Frames a second that are enough, as a share of what tells velocities to `max_mps` apart,
    # 4 f `max_mps` / c: of faster streams frames in a row are one. 0: every frame.
    sampling: float = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows (velocities) and columns (time cells)."""
        return 2 * int(self.max_mps / self.step_mps + 1e-9) + 1, self.n_cells

    def transform(self, dwell: Dwell, column_rate_hz: float | None = None) -> VelocityTransform:
        """Return what makes the columns of a stream; FeatureError for bad settings."""
        axis, n_slow, n_mean, cpi_s = dwell.axis, len(dwell.frames), 1, self.cpi_s
        if self.sampling:
            enough_hz = self.sampling * 4 * axis.carrier_hz * self.max_mps / SPEED_OF_LIGHT_MPS
            n_mean = max(1, int(dwell.frame_rate_hz / enough_hz))
        rate_hz = dwell.frame_rate_hz / n_mean
        if self.carrier_hz:
            cpi_s *= self.carrier_hz / axis.carrier_hz
        most_s = _MAX_SHARE * n_slow / dwell.frame_rate_hz
        cpi_s = max(min(cpi_s, most_s), self.least_frames / rate_hz)
        return VelocityTransform(
            axis,
            dwell.frame_rate_hz,
            max_mps=self.max_mps,
            step_mps=self.step_mps,
            cpi_s=cpi_s,
            column_rate_hz=column_rate_hz or 1 / self.cell_s,
            n_keep=n_slow,
            n_mean=n_mean,
        )

    def read(self, transform: VelocityTransform) -> NDArray[np.float32]:
        """Return the map, 0 to 1, of the dwell that ends with the last column; 0 where unknown."""
        rate_hz = transform.column_rate_hz
        n = min(transform.n_columns, math.ceil(self.n_cells * self.cell_s * rate_hz) + 1)
        columns, valid = transform.columns(n), transform.columns_valid(n)
        cell_s, n_cells = self.cell_s, self.n_cells
        power, known = time_cells(columns, valid, rate_hz, cell_s=cell_s, n_cells=n_cells)
        return shown(power, known, self.depth_db)
