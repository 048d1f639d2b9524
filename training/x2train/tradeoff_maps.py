"""The chain from frames to pictures with its switches: what `train-export tradeoff` times.

It is the daemon's own chain (down-conversion, clutter removal, maps, pictures), hop by hop,
but for two things that the daemon does not offer: maps in float64, and any column stride.
"""

from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray

from radard.clutter_map import ClutterRemover
from radard.dsp.columns import ColumnStream, SharedSteps
from radard.dsp.downconvert import DownConverter
from radard.dsp.gram import centring, gaussian_taper
from radard.dsp.grid import time_cells
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.streaming import StreamingDoppler
from radard.dsp.velocity import VelocityTransform
from radard.dsp.wideband import range_dft, velocity_operator
from radard.maps import shown
from radard.ring import Dwell
from x2radar.frame import FastTimeAxis

CPI_S = 28 / 60
VELOCITY_CPI_S = 0.2
DWELL_S = 2.0
CELL_S = 0.05
NEAR_M, FAR_M, CELL_M = 0.4, 4.4, 0.1
MAX_MPS = 5.0
VELOCITY_DEPTH_DB, RANGE_DEPTH_DB, DOPPLER_DEPTH_DB = 25.0, 30.0, 25.0
_FLATTEN = 1.5

Picture = NDArray[np.float32]
Samples = NDArray[np.float32] | NDArray[np.complex64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Where every switch stands; the defaults are those of the shipped bundles.

    Attributes
    ----------
    source : {'rf', 'baseband'}
        What the module sends.
    decimation : int
        Keep every so many range bins behind the matched filter.
    stride : int
        Frames from one column of the velocity map to the next.
    step_mps : float
        Distance of the velocity map's rows.
    precision : {32, 64}
        Bits of the maps' arithmetic.
    bands : int
        Range bands of a spectrogram that is made instead of the two maps; 0 for the maps.
    """

    source: str = "rf"
    decimation: int = 8
    stride: int = 3
    step_mps: float = 0.1
    precision: int = 32
    bands: int = 0

    def but(self, name: str, value: str | float) -> "Setting":
        """Return this with one switch set."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return Setting(**{**values, name: value})


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """What one hop shows.

    Attributes
    ----------
    maps : dict of str to ndarray, float32
        'velocity_time' and 'range_time', or 'spectrogram'; 0 to 1 over `depth_db`.
    depth_db : dict of str to float
        By the same names.
    """

    maps: dict[str, Picture]
    depth_db: dict[str, float]


class Chain:
    """Frames in, pictures out.

    Parameters
    ----------
    axis : FastTimeAxis
        Of the frames.
    frame_rate_hz : float
        Frames per second; a hop is one second.
    setting : Setting
        Where the switches stand.
    """

    def __init__(self, axis: FastTimeAxis, frame_rate_hz: float, setting: Setting) -> None:
        self._converter = DownConverter(axis, setting.decimation)
        self._axis = self._converter.axis
        self._rate_hz = frame_rate_hz
        self._n_cpi = max(4, round(CPI_S * frame_rate_hz))
        n_slow = round(DWELL_S * frame_rate_hz) + self._n_cpi - 1
        self._rows = np.zeros((n_slow, self._axis.n_range), np.complex64)
        self._remover = ClutterRemover()
        self._setting = setting
        self._maps = _maps(self._axis, frame_rate_hz, self._n_cpi, setting)
        streams = [m for m in self._maps.values() if isinstance(m, ColumnStream)]
        self._shared = SharedSteps(*streams) if streams else None
        self._n_taken = 0
        self.moving: Dwell | None = None
        """Last dwell without its clutter."""

    def hop(self, samples: Samples) -> Pictures | None:
        """Take a hop's frames; return what the dwell shows, None before the first whole one."""
        n_new, n_slow = len(samples), len(self._rows)
        self._rows[:-n_new] = self._rows[n_new:]
        self._converter.convert(samples, self._rows[-n_new:])
        self._n_taken += n_new
        if self._n_taken < n_slow:
            return None
        valid = np.ones(n_slow, np.bool_)
        t_s = self._n_taken / self._rate_hz
        dwell = Dwell(self._rows, valid, self._axis, self._rate_hz, t_s)
        first = self.moving is None
        self.moving = moving = self._remover.remove(dwell)
        new = slice(None) if first else slice(-n_new, None)
        double = self._maps.get("double")
        if isinstance(double, DoubleMaps):
            double.push(moving.frames[new])
        elif self._shared is not None:
            self._shared.push(moving.frames[new], moving.valid[new])
        return self._pictures()

    def _pictures(self) -> Pictures:
        doppler, double = self._maps.get("spectrogram"), self._maps.get("double")
        if isinstance(doppler, StreamingDoppler):
            power = doppler.columns(round(DWELL_S * self._rate_hz))
            stack = power.reshape(-1, power.shape[-1])
            good = np.ones(stack.shape[1], np.bool_)
            maps = {"spectrogram": shown(stack, good, DOPPLER_DEPTH_DB)}
            return Pictures(maps, {"spectrogram": DOPPLER_DEPTH_DB})
        if isinstance(double, DoubleMaps):
            velocity, ranges = double.velocity, double.ranges
        else:
            transform, cells = self._maps["velocity_time"], self._maps["range_time"]
            assert isinstance(transform, VelocityTransform)  # noqa: S101 - as `_maps` made them
            assert isinstance(cells, RangeTimeMap)  # noqa: S101
            velocity, ranges = transform.columns(), cells.columns()
        rate_hz = self._rate_hz
        return Pictures(
            {
                "velocity_time": _on_cells(
                    velocity, rate_hz / self._setting.stride, VELOCITY_DEPTH_DB
                ),
                "range_time": _on_cells(ranges, rate_hz, RANGE_DEPTH_DB),
            },
            {"velocity_time": VELOCITY_DEPTH_DB, "range_time": RANGE_DEPTH_DB},
        )


def _on_cells(power: NDArray[np.float64], rate_hz: float, depth_db: float) -> Picture:
    n_cells = round(DWELL_S / CELL_S)
    n = min(power.shape[1], int(np.ceil(DWELL_S * rate_hz)) + 1)
    good = np.ones(n, np.bool_)
    cells = time_cells(power[:, -n:], good, rate_hz, cell_s=CELL_S, n_cells=n_cells)
    return shown(*cells, depth_db)


class DoubleMaps:
    """Velocity-time and range-time maps in float64, hop by hop like those in float32.

    Parameters
    ----------
    ranges : RangeTimeMap
        Whose cells are used.
    transform : VelocityTransform
        Whose grids are used.
    axis, frame_rate_hz
        As of the chain.
    n_cpi : int
        Frames in a CPI of the range map.
    """

    def __init__(
        self,
        ranges: RangeTimeMap,
        transform: VelocityTransform,
        axis: FastTimeAxis,
        frame_rate_hz: float,
        n_cpi: int,
    ) -> None:
        self._n_cpi, self._stride = n_cpi, transform.stride
        self._n_fast = transform.n_cpi
        self._dft = range_dft(axis, transform.frequency_hz, _FLATTEN)
        self._operator = velocity_operator(
            transform.frequency_hz,
            transform.velocity_mps,
            frame_rate_hz,
            gaussian_taper(self._n_fast),
        )
        self._share = ranges.weights[: axis.n_range].astype(np.float64)
        self._middle = centring(self._n_cpi)[self._n_cpi // 2]
        self._last: NDArray[np.complex128] | None = None
        self._steps = np.zeros((0, axis.n_range), np.complex128)
        self._spectra = np.zeros((0, len(transform.frequency_hz)), np.complex128)
        self._n_seen = 0
        n_rows = len(transform.velocity_mps), len(ranges.range_m)
        self.velocity = np.zeros((n_rows[0], 0))
        self.ranges = np.zeros((n_rows[1], 0))

    def push(self, frames: NDArray[np.complex64]) -> None:
        """Add frames; columns of the last two dwells or so are kept."""
        rows = frames.astype(np.complex128)
        before = rows[:1] if self._last is None else self._last
        steps = np.diff(rows, axis=0, prepend=before)
        self._last = rows[-1:]
        n_old = self._n_seen
        self._n_seen += len(rows)
        self._steps = np.concatenate([self._steps, steps])[-(len(rows) + self._n_cpi) :]
        spectra = np.concatenate([self._spectra, steps @ self._dft])
        self._spectra = spectra[-(len(rows) + self._n_cpi + self._stride) :]
        self._add_ranges(max(0, n_old - self._n_cpi + 1))
        self._add_velocities(max(0, n_old - self._n_fast + 1))

    def _add_ranges(self, earliest: int) -> None:
        """Add the columns of the CPIs that begin with frame `earliest` or later."""
        n = self._n_seen - self._n_cpi - earliest + 1
        if n < 1:
            return
        rows = self._steps[len(self._steps) - (n + self._n_cpi - 2) :]
        residual = np.zeros((n, len(rows)))
        for i in range(n):
            residual[i, i : i + self._n_cpi - 1] = self._middle
        z = residual @ rows
        power = (z.real**2 + z.imag**2) @ self._share
        self.ranges = np.concatenate([self.ranges, power.T], axis=1)[:, -400:]

    def _add_velocities(self, earliest: int) -> None:
        first = -(-earliest // self._stride) * self._stride
        n = (self._n_seen - self._n_fast - first) // self._stride + 1
        if n < 1:
            return
        rows = np.ascontiguousarray(self._spectra[len(self._spectra) - (self._n_seen - first) :].T)
        n_freq, width = len(rows), self._n_fast - 1
        s0, s1 = rows.strides
        windows = as_strided(rows[:, 1:], (n_freq, width, n), (s0, s1, self._stride * s1)).copy()
        lines = self._operator @ windows
        power = (lines.real**2 + lines.imag**2).sum(axis=0)
        self.velocity = np.concatenate([self.velocity, power], axis=1)[:, -400:]


def _maps(
    axis: FastTimeAxis, frame_rate_hz: float, n_cpi: int, setting: Setting
) -> dict[str, ColumnStream | DoubleMaps]:
    n_keep = round(DWELL_S * frame_rate_hz) + 2
    if setting.bands:
        edges = np.linspace(0, axis.n_range, setting.bands + 1).round().astype(int).tolist()
        bands = list(pairwise(edges))
        return {"spectrogram": StreamingDoppler(n_cpi, bands=bands, n_keep=n_keep)}
    transform = VelocityTransform(
        axis,
        frame_rate_hz,
        max_mps=MAX_MPS,
        step_mps=setting.step_mps,
        cpi_s=VELOCITY_CPI_S,
        column_rate_hz=frame_rate_hz / setting.stride,
        n_keep=n_keep,
    )
    ranges = RangeTimeMap(axis, n_cpi, cell_m=CELL_M, near_m=NEAR_M, far_m=FAR_M, n_keep=n_keep)
    if setting.precision == 64:
        return {"double": DoubleMaps(ranges, transform, axis, frame_rate_hz, n_cpi)}
    return {"velocity_time": transform, "range_time": ranges}
