"""The chain from frames to pictures with its switches, and what each switch costs and loses.

It is the daemon's own chain (down-conversion, clutter removal, maps, pictures), hop by hop,
but for two things that the daemon does not offer: maps in float64, and any column stride.
Cost is the CPU time of one hop of the whole chain. Loss is how far its pictures are from those of
the switch's finest value, all other switches the same, in decibels: rms over all that either of
the two shows, in dwells with an open gate.
"""

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from radard.config.sections import GateSettings
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import Gate
from radard.dsp.columns import SharedSteps
from radard.dsp.doppler import StreamingDoppler
from radard.dsp.downconvert import DownConverter
from radard.dsp.gram import centring, gaussian_taper
from radard.dsp.grid import time_cells
from radard.dsp.range_time import RangeTimeMap
from radard.dsp.velocity import CPI_S, VelocityTransform
from radard.dsp.wideband import range_dft, velocity_operator
from radard.errors import UsageError
from radard.judge.display_db import shown
from radard.judge.features import FeatureSettings
from radard.judge.velocity_map import VelocityGrid
from radard.stream.ring import Dwell
from x2radar.frame import FastTimeAxis
from x2radar.ports import Port
from x2radar.radars import port_settings
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import load_scene
from x2train.sets.workers import Tell

DWELL_S, CELL_S = 2.0, 0.05  # as all bundles have them
NEAR_M, FAR_M, CELL_M = 0.4, 4.4, 0.1  # of the range-time map
RANGE_DEPTH_DB, DOPPLER_DEPTH_DB = 30.0, 25.0  # as the bundles' maps have them
_FEATURES = FeatureSettings(velocity_cpi_s=0.2)  # as the bundles'
_FLATTEN = 1.5  # as the velocity map's
_N_KEPT = 400  # columns in float64: two dwells at 200 Hz

Picture = NDArray[np.float32]
Samples = NDArray[np.float32] | NDArray[np.complex64]
Steps = NDArray[np.complex128]
Power = NDArray[np.float64]


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


@dataclass(frozen=True, slots=True)
class Switch:
    """One switch: its values, the finest first, and what the others stand at."""

    name: str
    title: str
    values: tuple[Any, ...]
    base: MapSetting = MapSetting()

    def settings(self) -> list[MapSetting]:
        """Return the settings with each value."""
        return [replace(self.base, **{self.name: value}) for value in self.values]


SWITCHES = (
    Switch("decimation", "range decimation", (1, 2, 4, 8, 16)),
    Switch("stride", "column stride", (1, 2, 3, 4, 6, 8)),
    Switch("step_mps", "velocity step, m/s", (0.025, 0.05, 0.1, 0.2, 0.4)),
    Switch("cpis", "velocity-time maps", (3, 2, 1)),
    Switch("precision", "bits of the maps", (64, 32)),
    Switch("source", "module sends", ("rf", "baseband")),
    Switch("bands", "range bands of the spectrogram", (8, 4, 2, 1), MapSetting(bands=8)),
)


@dataclass(frozen=True, slots=True)
class SwitchRow:
    """One value of one switch."""

    switch: str
    value: Any
    is_default: bool  # whether the shipped bundles have it there
    ms_per_hop: float  # CPU time in milliseconds: median over hops, best of the rounds
    ratio: float  # to the switch's finest value, in the same round; median over rounds
    loss_db: dict[str, float]  # by picture; 0 for the finest


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A scene's frames, in both kinds."""

    frame_rate_hz: float
    frames: dict[str, Samples]  # (n_frames, n_range): by what the module sends
    axes: dict[str, FastTimeAxis]  # likewise

    def hops(self, source: str) -> Iterator[Samples]:
        """Yield the frames of every whole second."""
        frames, n = self.frames[source], round(self.frame_rate_hz)
        yield from (frames[first : first + n] for first in range(0, len(frames) - n + 1, n))


@dataclass(frozen=True, slots=True, eq=False)
class MapPictures:
    """What one hop shows."""

    maps: dict[str, Picture]  # of `MAP_FEATURES`, or 'spectrogram'; 0 to 1 over `depth_db`
    depth_db: dict[str, float]  # by the same names


class DoubleMap:
    """A map in float64: columns of `n_cpi` frames, `stride` apart, from what frames change by.

    `project` leads from steps (n, n_range) to rows (n, width), `power` from the rows of every
    column, shape (n, width, n_cpi - 1), to the columns, shape (n_cells, n).
    """

    def __init__(
        self,
        n_cpi: int,
        stride: int,
        project: Callable[[Steps], Steps],
        power: Callable[[Steps], Power],
    ) -> None:
        self._n_cpi, self._stride, self._project, self._power = n_cpi, stride, project, power
        self._n_seen = 0
        self._rows: Steps | None = None
        self._columns: Power | None = None

    def columns(self) -> Power:
        """Return the columns that are kept, shape (n_cells, n)."""
        assert self._columns is not None  # noqa: S101 - asked after the first whole dwell
        return self._columns

    def push(self, steps: Steps) -> None:
        """Add steps from frame to frame."""
        first = -(-max(0, self._n_seen - self._n_cpi + 1) // self._stride) * self._stride
        self._n_seen += len(steps)
        new = self._project(steps)
        rows = new if self._rows is None else np.concatenate([self._rows, new])
        self._rows = rows[-(len(steps) + self._n_cpi + self._stride) :]
        n = (self._n_seen - self._n_cpi - first) // self._stride + 1
        if n < 1:
            return
        part = self._rows[len(self._rows) - (self._n_seen - first) + 1 :]
        made = self._power(sliding_window_view(part, self._n_cpi - 1, axis=0)[:: self._stride][:n])
        if self._columns is not None:
            made = np.concatenate([self._columns, made], axis=1)
        self._columns = made[:, -_N_KEPT:]


def double_ranges(ranges: RangeTimeMap, axis: FastTimeAxis, n_cpi: int) -> DoubleMap:
    """Return a range-time map with the cells of one in float32."""
    share = ranges.weights[: axis.n_range].astype(np.float64)
    middle = centring(n_cpi)[n_cpi // 2]

    def power(windows: Steps) -> Power:
        return np.asarray((_squared(windows @ middle) @ share).T)

    return DoubleMap(n_cpi, 1, lambda steps: steps, power)


def double_velocities(
    transform: VelocityTransform, axis: FastTimeAxis, frame_rate_hz: float
) -> DoubleMap:
    """Return a velocity-time map with the grid of one in float32."""
    frequency_hz, n_cpi = transform.frequency_hz, transform.n_cpi
    dft = range_dft(axis, frequency_hz, _FLATTEN)
    operator = velocity_operator(
        frequency_hz, transform.velocity_mps, frame_rate_hz, gaussian_taper(n_cpi)
    )

    def power(windows: Steps) -> Power:
        lines = operator @ np.ascontiguousarray(windows.transpose(1, 2, 0))
        return np.asarray(_squared(lines).sum(axis=0))

    return DoubleMap(n_cpi, transform.stride, lambda steps: steps @ dft, power)


def _squared(z: Steps) -> Power:
    return np.asarray(z.real**2 + z.imag**2)


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

    Attributes
    ----------
    moving : Dwell or None
        Last dwell without its clutter.
    """

    def __init__(self, axis: FastTimeAxis, frame_rate_hz: float, setting: MapSetting) -> None:
        self._converter = DownConverter(axis, setting.decimation)
        self._axis, self._rate_hz = self._converter.axis, frame_rate_hz
        n_cpi = max(4, round(CPI_S * frame_rate_hz))
        n_slow = round(DWELL_S * frame_rate_hz) + n_cpi - 1
        self._rows = np.zeros((n_slow, self._axis.n_range), np.complex64)
        self._remover = ClutterRemover()
        self._n_taken = 0
        self._last = np.zeros((1, self._axis.n_range), np.complex128)
        self.moving: Dwell | None = None
        self._double: dict[str, DoubleMap] = {}
        self._maps: dict[str, VelocityTransform | RangeTimeMap] = {}
        self._grids: dict[str, tuple[VelocityGrid, float]] = {}  # and columns a second
        self._bands: list[tuple[slice, StreamingDoppler]] = []  # range bins, and what sees them
        self._shared: SharedSteps | None = None
        if setting.bands:
            edges = np.linspace(0, self._axis.n_range, setting.bands + 1).round().astype(int)
            self._bands = [
                (slice(first, stop), StreamingDoppler(n_cpi, n_keep=n_slow))
                for first, stop in pairwise(edges.tolist())
            ]
            return
        ranges = RangeTimeMap(
            self._axis, n_cpi, cell_m=CELL_M, near_m=NEAR_M, far_m=FAR_M, n_keep=n_slow
        )
        features = replace(_FEATURES, velocity_step_mps=setting.step_mps)
        grids = dict(list(features.velocity_grids().items())[: setting.cpis])
        rate_hz = {"velocity_time": frame_rate_hz / setting.stride}
        blank = self._dwell()
        made = {name: grid.transform(blank, rate_hz.get(name)) for name, grid in grids.items()}
        self._grids = {name: (grids[name], t.column_rate_hz) for name, t in made.items()}
        self._maps = {**made, "range_time": ranges}
        self._shared = SharedSteps(*self._maps.values())
        if setting.precision == 64:
            self._double = {
                name: double_velocities(t, self._axis, frame_rate_hz) for name, t in made.items()
            }
            self._double["range_time"] = double_ranges(ranges, self._axis, n_cpi)

    def hop(self, samples: Samples) -> MapPictures | None:
        """Take a hop's frames; return what the dwell shows, None before the first whole one."""
        n_new, n_slow = len(samples), len(self._rows)
        self._rows[:-n_new] = self._rows[n_new:]
        self._converter.convert(samples, self._rows[-n_new:])
        self._n_taken += n_new
        if self._n_taken < n_slow:
            return None
        is_first = self.moving is None
        self.moving = moving = self._remover.remove(self._dwell())
        if self._double:
            rows = moving.frames[0 if is_first else -n_new :].astype(np.complex128)
            steps = np.diff(rows, axis=0, prepend=rows[:1] if is_first else self._last)
            self._last = rows[-1:]
            for each in self._double.values():
                each.push(steps)
        else:
            new = slice(None) if is_first else slice(-n_new, None)
            frames, valid = moving.frames[new], moving.valid[new]
            for part, doppler in self._bands:
                doppler.push(frames[:, part], valid)
            if self._shared is not None:
                self._shared.push(frames, valid)
        return self._pictures()

    def _dwell(self) -> Dwell:
        valid, t_s = np.ones(len(self._rows), np.bool_), self._n_taken / self._rate_hz
        return Dwell(self._rows, valid, self._axis, self._rate_hz, t_s)

    def _pictures(self) -> MapPictures:
        if self._bands:
            n = round(DWELL_S * self._rate_hz)
            stack = np.concatenate([doppler.columns(n) for _, doppler in self._bands])
            picture = shown(stack, np.ones(stack.shape[1], np.bool_), DOPPLER_DEPTH_DB)
            return MapPictures({"spectrogram": picture}, {"spectrogram": DOPPLER_DEPTH_DB})
        made = self._double or self._maps
        maps, depth_db = {}, {name: grid.depth_db for name, (grid, _) in self._grids.items()}
        for name, (grid, rate_hz) in self._grids.items():
            columns = made[name].columns()
            maps[name] = grid.picture(columns, np.ones(columns.shape[1], np.bool_), rate_hz)
        n = int(np.ceil(DWELL_S * self._rate_hz)) + 1
        power = np.asarray(made["range_time"].columns()[:, -n:])
        good = np.ones(power.shape[1], np.bool_)
        n_cells = round(DWELL_S / CELL_S)
        cells = time_cells(power, good, self._rate_hz, cell_s=CELL_S, n_cells=n_cells)
        maps["range_time"] = shown(*cells, RANGE_DEPTH_DB)
        return MapPictures(maps, {**depth_db, "range_time": RANGE_DEPTH_DB})


def record(scene: str, frame_rate_hz: float, duration_s: float, seed: int) -> Recording:
    """Simulate a scene as RF and as baseband; a lost frame repeats the one before."""
    frames: dict[str, Samples] = {}
    axes = {}
    for kind in ("rf", "baseband"):
        spec = Port("sim", scene, {"rate": f"{frame_rate_hz:g}", "kind": kind})
        settings = port_settings(spec)
        assert not callable(settings)  # noqa: S101 - only device=auto needs a module
        stream = EchoStream(load_scene(scene), seed, settings)
        rows: list[NDArray[Any]] = []
        for _ in range(round(duration_s * frame_rate_hz)):
            row = stream.next()
            rows.append(row if row is not None else rows[-1])
        frames[kind], axes[kind] = np.stack(rows), stream.axis
    return Recording(frame_rate_hz, frames, axes)


def measure(
    recordings: Sequence[Recording], rounds: int, tell: Tell, switches: Sequence[Switch] = SWITCHES
) -> list[SwitchRow]:
    """Measure switches on recordings, timed in rounds."""
    open_hops = _some_open(recordings)
    rows: list[SwitchRow] = []
    done, total = 0, rounds * sum(len(switch.values) for switch in switches)
    for switch in switches:
        settings = switch.settings()
        seconds: list[list[float]] = [[] for _ in settings]
        shows: list[list[MapPictures]] = [[] for _ in settings]
        for _ in range(rounds):
            # The values of a switch take turns, so that a busy machine is busy for all.
            for k, setting in enumerate(settings):
                hops_s, shows[k] = _run(recordings, setting, open_hops)
                seconds[k].append(statistics.median(hops_s))
                done += 1
                tell(done, total)
        for k, (value, setting) in enumerate(zip(switch.values, settings, strict=True)):
            ratios = [a / b for a, b in zip(seconds[k], seconds[0], strict=True)]
            is_default = setting == MapSetting()
            losses = _losses(shows[k], shows[0], setting.bands)
            ms, ratio = 1e3 * min(seconds[k]), statistics.median(ratios)
            rows.append(SwitchRow(switch.name, value, is_default, ms, ratio, losses))
    return rows


def chain_ms(
    recordings: Sequence[Recording], settings: Sequence[MapSetting], rounds: int, tell: Tell
) -> dict[MapSetting, float]:
    """Return the CPU time of a hop with an open gate, in ms of the best round, by setting."""
    open_hops = _some_open(recordings)
    best = dict.fromkeys(settings, np.inf)
    in_turn = [setting for _ in range(rounds) for setting in settings]
    for done, setting in enumerate(in_turn, 1):
        hops_s, _ = _run(recordings, setting, open_hops)
        best[setting] = min(best[setting], 1e3 * statistics.median(hops_s))
        tell(done, len(in_turn))
    return best


def picture_loss_db(ours: Picture, finest: Picture, depth_db: float) -> float:
    """Return the rms difference of two pictures of one kind over what either shows, in dB."""
    if len(ours) != len(finest):
        at = np.linspace(0, len(ours) - 1, len(finest))
        low = np.minimum(at.astype(int), len(ours) - 2)
        share = (at - low)[:, None]
        ours = ours[low] * (1 - share) + ours[low + 1] * share
    seen = (ours > 0) | (finest > 0)
    if not seen.any():
        return 0.0
    return depth_db * float(np.sqrt(np.mean((ours[seen] - finest[seen]) ** 2, dtype=np.float64)))


def _losses(
    ours: Sequence[MapPictures], finest: Sequence[MapPictures], n_bands: int
) -> dict[str, float]:
    losses: dict[str, list[float]] = {}
    for mine, best in zip(ours, finest, strict=True):
        for name, picture in mine.maps.items():
            reference = best.maps[name]
            fine = picture
            if name == "spectrogram":
                # Every fine band is taken to show what the band around it does.
                bands = picture.reshape(n_bands, -1, picture.shape[1])
                fine = np.repeat(bands, len(reference) // len(picture), axis=0)
                fine = fine.reshape(reference.shape)
            loss_db = picture_loss_db(fine, reference, best.depth_db[name])
            losses.setdefault(name, []).append(loss_db)
    return {name: float(np.sqrt(np.mean(np.square(each)))) for name, each in losses.items()}


def _run(
    recordings: Sequence[Recording], setting: MapSetting, open_hops: Sequence[Sequence[bool]]
) -> tuple[list[float], list[MapPictures]]:
    hops_s, found = [], []
    for recording, is_open in zip(recordings, open_hops, strict=True):
        chain = Chain(recording.axes[setting.source], recording.frame_rate_hz, setting)
        for k, samples in enumerate(recording.hops(setting.source)):
            started_s = time.thread_time()
            pictures = chain.hop(samples)
            taken_s = time.thread_time() - started_s
            if pictures is not None and is_open[k]:
                found.append(pictures)
                hops_s.append(taken_s)
    return hops_s, found


def _some_open(recordings: Sequence[Recording]) -> list[list[bool]]:
    open_hops = [_open_hops(r) for r in recordings]
    if not any(map(any, open_hops)):
        msg = "nothing moves in these scenes: the gate never opens"
        raise UsageError(msg)
    return open_hops


def _open_hops(recording: Recording) -> list[bool]:
    """Return in which hops the daemon's gate is open, at the default setting."""
    setting = MapSetting()
    chain = Chain(recording.axes[setting.source], recording.frame_rate_hz, setting)
    gate = Gate(GateSettings())
    is_open = []
    for samples in recording.hops(setting.source):
        shows = chain.hop(samples) is not None and chain.moving is not None
        is_open.append(bool(shows and chain.moving and gate.read(chain.moving).is_open))
    # The first dwell is not timed: it is made from nothing.
    if True in is_open:
        is_open[is_open.index(True)] = False
    return is_open
