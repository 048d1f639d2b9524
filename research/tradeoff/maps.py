"""The chain from frames to pictures with its switches: what `train-export tradeoff` times.

It is the daemon's own chain (down-conversion, clutter removal, maps, pictures), hop by hop,
but for two things that the daemon does not offer: maps in float64, and any column stride.
"""

from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from radard.detect.clutter_map import ClutterRemover
from radard.dsp.columns import SharedSteps
from radard.dsp.downconvert import DownConverter
from radard.dsp.grid import time_cells
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.streaming import StreamingDoppler
from radard.dsp.velocity import CPI_S, VelocityTransform
from radard.judge.display_db import shown
from radard.judge.features import FeatureSettings
from radard.judge.velocity_map import VelocityGrid
from radard.stream.ring import Dwell
from research.tradeoff.double import DoubleMaps, DoubleRanges
from x2radar.frame import FastTimeAxis

DWELL_S = 2.0  # as all bundles have it
CELL_S = 0.05  # likewise
NEAR_M, FAR_M, CELL_M = 0.4, 4.4, 0.1  # of the range-time map: chosen
RANGE_DEPTH_DB, DOPPLER_DEPTH_DB = 30.0, 25.0  # as the bundles' maps have them
_FEATURES = FeatureSettings(velocity_cpi_s=0.2)  # as the bundles'

Picture = NDArray[np.float32]
Samples = NDArray[np.float32] | NDArray[np.complex64]


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSetting:
    """Where every switch stands; the defaults are those of the shipped bundles."""

    source: str = "rf"  # 'rf' or 'baseband', as the module sends
    decimation: int = 8  # keep every so many range bins behind the matched filter
    stride: int = 3  # frames from one column of the velocity map to the next
    step_mps: float = 0.1  # distance of the velocity map's rows
    cpis: int = 3  # velocity-time maps: the short CPI's, the medium's, the long's
    precision: int = 32  # 32 or 64 bits of the maps' arithmetic
    # range bands of a spectrogram that is made instead of the two maps; 0 for the maps
    bands: int = 0

    def but(self, name: str, value: str | float) -> "MapSetting":
        """Return this with one switch set."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return MapSetting(**{**values, name: value})


@dataclass(frozen=True, slots=True, eq=False)
class MapPictures:
    """What one hop shows."""

    maps: dict[str, Picture]  # of `MAP_FEATURES`, or 'spectrogram'; 0 to 1 over `depth_db`
    depth_db: dict[str, float]  # by the same names


class Chain:
    """Frames in, pictures out.

    Parameters
    ----------
    axis : FastTimeAxis
        Of the frames.
    frame_rate_hz : float
        Frames per second; a hop is one second.
    setting : MapSetting
        Where the switches stand.
    """

    def __init__(self, axis: FastTimeAxis, frame_rate_hz: float, setting: MapSetting) -> None:
        self._converter = DownConverter(axis, setting.decimation)
        self._axis = self._converter.axis
        self._rate_hz = frame_rate_hz
        self._n_cpi = max(4, round(CPI_S * frame_rate_hz))
        n_slow = round(DWELL_S * frame_rate_hz) + self._n_cpi - 1
        self._rows = np.zeros((n_slow, self._axis.n_range), np.complex64)
        self._remover = ClutterRemover()
        valid = np.ones(n_slow, np.bool_)
        blank = Dwell(self._rows, valid, self._axis, frame_rate_hz, 0.0)
        self._grids = _grids(setting)
        self._doppler: StreamingDoppler | None = None
        self._maps: dict[str, VelocityTransform | RangeTimeMap] = {}
        self._double: DoubleMaps | None = None
        if setting.bands:
            edges = np.linspace(0, self._axis.n_range, setting.bands + 1).round().astype(int)
            bands = list(pairwise(edges.tolist()))
            self._doppler = StreamingDoppler(self._n_cpi, bands=bands, n_keep=n_slow)
        else:
            ranges = RangeTimeMap(
                self._axis, self._n_cpi, cell_m=CELL_M, near_m=NEAR_M, far_m=FAR_M, n_keep=n_slow
            )
            rate_hz = {"velocity_time": frame_rate_hz / setting.stride}
            transforms = {
                name: grid.transform(blank, rate_hz.get(name))
                for name, grid in self._grids.items()
            }
            if setting.precision == 64:
                self._double = DoubleMaps(
                    ranges, transforms, self._axis, frame_rate_hz, self._n_cpi
                )
            else:
                self._maps = {**transforms, "range_time": ranges}
        streams = [self._doppler] if self._doppler else list(self._maps.values())
        self._shared = SharedSteps(*streams) if streams else None
        self._n_taken = 0
        self.moving: Dwell | None = None
        """Last dwell without its clutter."""

    def hop(self, samples: Samples) -> MapPictures | None:
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
        if self._double is not None:
            self._double.push(moving.frames[new])
        elif self._shared is not None:
            self._shared.push(moving.frames[new], moving.valid[new])
        return self._pictures()

    def _pictures(self) -> MapPictures:
        if self._doppler is not None:
            power = self._doppler.columns(round(DWELL_S * self._rate_hz))
            stack = power.reshape(-1, power.shape[-1])
            good = np.ones(stack.shape[1], np.bool_)
            maps = {"spectrogram": shown(stack, good, DOPPLER_DEPTH_DB)}
            return MapPictures(maps, {"spectrogram": DOPPLER_DEPTH_DB})
        made = self._double.made if self._double else self._maps
        maps, depth_db = {}, {}
        for name, source in made.items():
            columns = source.columns()
            good = np.ones(columns.shape[1], np.bool_)
            if name in self._grids:
                grid = self._grids[name]
                assert not isinstance(source, RangeTimeMap | DoubleRanges)  # noqa: S101 - as they were made
                maps[name] = grid.picture(columns, good, source.column_rate_hz)
                depth_db[name] = grid.depth_db
            else:
                maps[name] = _on_cells(columns, self._rate_hz, RANGE_DEPTH_DB)
                depth_db[name] = RANGE_DEPTH_DB
        return MapPictures(maps, depth_db)


def _grids(setting: MapSetting) -> dict[str, VelocityGrid]:
    features = replace(_FEATURES, velocity_step_mps=setting.step_mps)
    return dict(list(features.velocity_grids().items())[: setting.cpis])


def _on_cells(power: NDArray[np.float64], rate_hz: float, depth_db: float) -> Picture:
    n_cells = round(DWELL_S / CELL_S)
    n = min(power.shape[1], int(np.ceil(DWELL_S * rate_hz)) + 1)
    good = np.ones(n, np.bool_)
    cells = time_cells(power[:, -n:], good, rate_hz, cell_s=CELL_S, n_cells=n_cells)
    return shown(*cells, depth_db)
