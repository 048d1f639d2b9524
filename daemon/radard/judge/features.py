"""Dwell to features: the code that the daemon and the training both call.

A bundle's sidecar says which of `FEATURES` its network takes and with which settings.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from radard.config.json_file import STRICT, parse_json
from radard.dsp.cadence import cadence_velocity_diagram, extent_profile, type1_vector
from radard.dsp.columns import SharedSteps
from radard.dsp.doppler import StreamingDoppler
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.velocity import CPI_S
from radard.errors import FeatureError, ModelMismatch
from radard.judge.installation import INSTALLATION, N_INSTALLATION, installation
from radard.judge.velocity_map import VelocityGrid, busiest_rows, shown
from radard.stream.ring import Dwell, DwellShape
from x2radar.frame import FastTimeAxis
from x2radar.plugins import Plugin, find_plugin

_Whole = Annotated[float, Field(ge=0, le=1e3)]
_Part = Annotated[float, Field(ge=1e-3, le=1e3)]  # something is divided into so many
_Count = Annotated[int, Field(ge=1, le=100_000)]


@dataclass(frozen=True, slots=True, kw_only=True)
class FeatureSettings:
    """How features are made; part of a bundle's sidecar. Keys in metres, seconds and dB."""

    __pydantic_config__ = STRICT

    dwell_s: _Part = 2.0  # length of the spectrogram
    # frames in a CPI of the spectrogram; 0: 28/60 s at any rate
    n_cpi: Annotated[int, Field(ge=0, le=100_000)] = 28
    n_cadence: _Count = 28  # columns of the cadence velocity diagram that are used
    n_profile: _Count = 392  # length of the range profile of the type 2 vector
    range_decimation: _Count = 1  # keep every so many range bins behind the matched filter
    # Frames as they come, each CPI losing its own mean; or 'removed': without the clutter map and
    # its jitter (`radard.detect.clutter_map`).
    clutter: Literal["cpi", "removed"] = "cpi"
    cell_s: _Part = 0.05  # time cell of the maps
    velocity_max_mps: _Part = 5.0  # grid of the velocity-time map
    velocity_step_mps: _Part = 0.1
    velocity_cpi_s: _Part = CPI_S  # 0.47 resolves 0.07 m/s, 0.2 the swing of a leg
    # see `VelocityGrid.carrier_hz`
    velocity_cpi_carrier_hz: Annotated[float, Field(ge=0, le=1e12)] = 0.0
    velocity_cpi_frames: _Count = 4  # fewest of a CPI
    medium_cpi_s: _Part = 0.6  # the map with the medium CPI, see `radard.judge.velocity_map`
    medium_max_mps: _Part = 1.5
    medium_step_mps: _Part = 0.05
    medium_cell_s: _Part = 0.075
    long_cpi_s: _Part = 1.5  # the map with the long CPI
    long_max_mps: _Part = 0.6
    long_step_mps: _Part = 0.015
    long_cell_s: _Part = 0.1
    long_sampling: _Whole = 0.0  # of the maps with longer CPIs, see `VelocityGrid.sampling`
    # The range-time map shows `near_m` to `far_m`; or 'target': as many metres of the swath where
    # most moves, wherever that is (`radard.judge.velocity_map.busiest_rows`).
    range_window: Literal["fixed", "target"] = "fixed"
    near_m: _Whole = 0.4
    far_m: _Whole = 4.4
    cell_m: _Part = 0.1  # cells outside the swath stay empty
    velocity_depth_db: _Part = 25.0  # what is shown, see `radard.judge.velocity_map`
    long_depth_db: _Part = 30.0  # of both maps with longer CPIs
    range_depth_db: _Part = 30.0

    @classmethod
    def from_mapping(cls, raw: Mapping[str, Any]) -> "FeatureSettings":
        """Read the settings of a sidecar; raise ModelMismatch on an unknown or wrong one."""
        try:
            return parse_json(cls, json.dumps(raw), "features")
        except ValueError as err:
            raise ModelMismatch(str(err)) from err

    @property
    def n_cells(self) -> int:
        """Time cells of a map."""
        return max(1, round(self.dwell_s / self.cell_s))

    def velocity_grids(self) -> Mapping[str, VelocityGrid]:
        """Return the velocity-time maps by their features' names."""
        x = self
        rows = (
            ("", x.velocity_cpi_s, x.velocity_max_mps, x.velocity_step_mps, x.cell_s),
            ("_medium", x.medium_cpi_s, x.medium_max_mps, x.medium_step_mps, x.medium_cell_s),
            ("_long", x.long_cpi_s, x.long_max_mps, x.long_step_mps, x.long_cell_s),
        )
        return {
            f"velocity_time{name}": VelocityGrid(
                cpi_s=cpi_s,
                carrier_hz=self.velocity_cpi_carrier_hz,
                least_frames=self.velocity_cpi_frames,
                max_mps=max_mps,
                step_mps=step_mps,
                cell_s=cell_s,
                # The whole cells of a dwell's columns behind the first CPI of that length.
                n_cells=max(1, int((self.dwell_s + CPI_S - cpi_s) / cell_s + 1e-9))
                if name
                else self.n_cells,
                depth_db=self.long_depth_db if name else self.velocity_depth_db,
                sampling=self.long_sampling if name else 0.0,
            )
            for name, cpi_s, max_mps, step_mps, cell_s in rows
        }

    def at(self, frame_rate_hz: float) -> "FeatureSettings":
        """Return these settings with the CPI in frames of a stream; `n_cpi` 0 means 28/60 s."""
        if self.n_cpi:
            return self
        return replace(self, n_cpi=max(2, round(CPI_S * frame_rate_hz)))

    def dwell_shape(self, hop_s: float, frame_rate_hz: float) -> DwellShape:
        """Return the shape of dwells whose spectrogram has `dwell_s` of columns."""
        n_slow = max(2, round(self.dwell_s * frame_rate_hz)) + self.n_cpi - 1
        return DwellShape(n_slow=n_slow, hop_s=hop_s, frame_rate_hz=frame_rate_hz)

    def range_step(self, axis: FastTimeAxis) -> int:
        """Return how many bins of a stream become one: other modules' are coarse already."""
        return min(self.range_decimation, max(1, int(_COARSE_BIN_M / axis.bin_length_m)))

    @property
    def n_range_cells(self) -> int:
        """Rows of the range-time map."""
        return max(1, int((self.far_m - self.near_m) / self.cell_m + 1e-9))


Features = Mapping[str, NDArray[np.float32]]
"""What is known of one dwell: what was asked for, by its name in `FEATURES`."""
THESIS_FEATURES = ("thesis_type1", "thesis_type2")
MAP_FEATURES = ("velocity_time", "velocity_time_medium", "velocity_time_long", "range_time")
FEATURES = (*THESIS_FEATURES, *MAP_FEATURES, INSTALLATION)
"""Every feature that a network may ask for."""
PLUGGED = "radard.features"  # the group of entry points with further ones (`FeatureMaker`)
_COARSE_BIN_M = 0.03
"""Behind the matched filter an X2's bins may be that long without loss (41 GS/s, 8 of them)."""


class FeatureMaker(Protocol):
    """What an entry point of `radard.features` names; its own name is the feature's."""

    def shape(self, settings: FeatureSettings) -> tuple[int, ...]:
        """Return the shape of the feature."""

    def extract(self, dwell: Dwell, settings: FeatureSettings) -> NDArray[np.float32]:
        """Return the feature of a dwell, float32, of that shape; the dwell is not changed."""


def feature_shape(name: str, settings: FeatureSettings) -> tuple[int, ...]:
    """Return the shape of a feature; raise ModelMismatch if there is no such feature."""
    n_type1 = settings.n_cpi * settings.n_cadence
    shapes = {
        "thesis_type1": (n_type1,),
        "thesis_type2": (n_type1 + settings.n_profile,),
        **{name: grid.shape for name, grid in settings.velocity_grids().items()},
        "range_time": (settings.n_range_cells, settings.n_cells),
        INSTALLATION: (N_INSTALLATION,),
    }
    if name not in shapes:
        plugin = find_plugin(PLUGGED, name)
        if plugin is not None:
            plugin.check(plugin.made, ("shape", "extract"))
            return tuple(plugin.guard(lambda: plugin.made.shape(settings)))
        raise ModelMismatch(f"feature '{name}': unknown; this radard makes {', '.join(FEATURES)}")
    return shapes[name]


class FeatureStream:
    """Features of a stream's dwells: what the last dwell has made is not made again.

    Dwells may be left out; one that does not follow on the last is taken whole. Either way the
    features are the same to 1e-6 of a map's power. `names` are of `FEATURES` or plug-ins'.
    """

    def __init__(self, settings: FeatureSettings, names: tuple[str, ...]) -> None:
        self._settings, self._names = settings, names
        self._grids = settings.velocity_grids()
        self._end_frame: int | None = None
        found = ((name, find_plugin(PLUGGED, name)) for name in names if name not in FEATURES)
        self._plugged = {name: plugin for name, plugin in found if plugin is not None}

    def _begin(self, dwell: Dwell) -> None:
        """Make the maps that some features need, which are fed together."""
        settings, n_keep = self._settings, len(dwell.frames)
        for name in self._names:
            feature_shape(name, settings)
        wanted = (name for name in self._names if name in self._grids)
        self._velocity = {name: self._grids[name].transform(dwell) for name in wanted}
        self._doppler = self._ranges = None
        if not set(THESIS_FEATURES).isdisjoint(self._names):
            self._doppler = StreamingDoppler(settings.n_cpi, n_keep=n_keep)
        if "range_time" in self._names:
            n_cpi, how = max(4, round(CPI_S * dwell.frame_rate_hz)), {"cell_m": settings.cell_m}
            if settings.range_window == "fixed":
                how |= {"near_m": settings.near_m, "far_m": settings.far_m}
            self._ranges = RangeTimeMap(dwell.axis, n_cpi, n_keep=n_keep, **how)
        made = (self._doppler, self._ranges, *self._velocity.values())
        fed = [each for each in made if each is not None]
        # Plug-ins alone share nothing.
        self._shared = SharedSteps(*fed) if fed else None

    def extract(self, dwell: Dwell, known: NDArray[np.float32] | None = None) -> Features:
        """Return one dwell's features, `known` of the installation; FeatureError if too short."""
        settings = self._settings
        n_slow = len(dwell.frames)
        n_columns = n_slow - settings.n_cpi + 1
        if n_columns < 1:
            raise FeatureError(f"{n_slow} frames cannot fill a CPI of {settings.n_cpi}")
        n_new = 0 if self._end_frame is None else dwell.end_frame - self._end_frame
        if not 0 < n_new < n_slow:
            self._begin(dwell)
            n_new = n_slow
        if self._shared is not None:
            self._shared.push(dwell.frames[-n_new:], dwell.valid[-n_new:])
        self._end_frame = dwell.end_frame
        inputs = {INSTALLATION: installation(dwell.frame_rate_hz) if known is None else known}
        if self._doppler is not None:
            diagram = cadence_velocity_diagram(_spectrogram(self._doppler, n_columns))
            inputs["thesis_type1"] = type1 = type1_vector(diagram, settings.n_cadence)
            if "thesis_type2" in self._names:
                profile = extent_profile(dwell.frames, settings.n_cpi, settings.n_profile)
                inputs["thesis_type2"] = np.concatenate([profile, type1])
        for name, transform in self._velocity.items():
            inputs[name] = self._grids[name].read(transform)
        if self._ranges is not None:
            power, valid = self._ranges.cells(
                dwell.frame_rate_hz, cell_s=settings.cell_s, n_cells=settings.n_cells
            )
            if settings.range_window == "target":
                power = busiest_rows(power, settings.n_range_cells)
            inputs["range_time"] = shown(power, valid, settings.range_depth_db)
        for name, plugin in self._plugged.items():
            inputs[name] = _plugged_feature(plugin, dwell, settings)
        return {name: inputs[name] for name in self._names}


def _plugged_feature(
    plugin: Plugin, dwell: Dwell, settings: FeatureSettings
) -> NDArray[np.float32]:
    made = plugin.guard(lambda: plugin.made.extract(dwell, settings))
    shape = tuple(plugin.made.shape(settings))
    if not isinstance(made, np.ndarray) or made.shape != shape or made.dtype != np.float32:
        has = f"{made.dtype} {made.shape}" if isinstance(made, np.ndarray) else type(made).__name__
        raise FeatureError(f"{plugin.about}: gives {has}, not float32 {shape}")
    return made


def _spectrogram(doppler: StreamingDoppler, n_columns: int) -> NDArray[np.float32]:
    """Return mu over a power of two, so that it fits float32; masked columns take the mean."""
    columns = doppler.columns(n_columns)
    exponent = int(np.frexp(columns.max(initial=0.0))[1])
    share = np.ldexp(columns, -exponent).astype(np.float32)
    valid = doppler.columns_valid(n_columns)
    if not valid.any():
        share[:] = 0
    elif not valid.all():
        share[:, ~valid] = share[:, valid].mean(axis=1, keepdims=True)
    return share


def extract(dwell: Dwell, settings: FeatureSettings, names: tuple[str, ...]) -> Features:
    """Return the features of a single dwell; see `FeatureStream.extract`."""
    return FeatureStream(settings, names).extract(dwell)
