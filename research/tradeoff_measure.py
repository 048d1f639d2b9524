"""What settings of the maps cost and lose, and how well bundles judge with them.

Cost is the CPU time of one hop with an open gate. Loss is how far the pictures of the daemon's
own `FeatureStream` are from those of a switch's finest value, all other switches the same, in
decibels: rms over all that either of the two shows. A window goes to every network as its bundle
wants it, at every decimation, with all of its velocity-time maps or with the longer ones blank.
No network is retrained: one that was made for what it is given here could do better.
"""

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.config.sections import GateSettings
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import Gate
from radard.dsp.downconvert import DownConverter
from radard.dsp.velocity import CPI_S, VelocityTransform
from radard.errors import UsageError
from radard.judge.bundle import CLASSES, Bundle
from radard.judge.classifier import HIDDEN
from radard.judge.features import MAP_FEATURES, Features, FeatureSettings, FeatureStream
from radard.judge.installation import INSTALLATION, installation
from radard.judge.velocity_map import VelocityGrid
from radard.stream.ring import Dwell
from x2radar.frame import FastTimeAxis
from x2radar.ports import Port
from x2radar.radars import port_settings
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import load_scene
from x2train.judge.estimates import Estimate, Ranking, resampled
from x2train.judge.judging import JudgeSpec
from x2train.nets.bundle_answers import outputs_of, session_of
from x2train.sets.families import LABELS
from x2train.sets.passages import Passage
from x2train.sets.sites import ONE_RADAR
from x2train.sets.window_set import inputs_of
from x2train.sets.windows import windows_of
from x2train.sets.workers import Tell

RADAR = "thesis"
"""An X2 with all its bins."""
_CALLS = 200  # of a network, of which the median counts
_REPLICATES = 400  # more than reports, since rows are compared
_HUMAN, _PET = LABELS.index("human"), LABELS.index("pet")
Samples = NDArray[np.float32] | NDArray[np.complex64]
Columns = Mapping[str, NDArray[Any]]
Way = tuple[FeatureSettings, int]
"""How maps are made, and at which decimation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSetting:
    """Where every switch stands; the defaults are those of the shipped bundles."""

    source: str = "rf"  # 'rf' or 'baseband', as the module sends
    decimation: int = 8  # keep every so many range bins behind the matched filter
    stride: int = 3  # frames from one column of the velocity map to the next
    step_mps: float = 0.1  # distance of the velocity map's rows
    cpis: int = 3  # velocity-time maps: the short CPI's, the medium's, the long's


@dataclass(frozen=True, slots=True)
class Switch:
    """One switch, and its values, the finest first."""

    name: str
    title: str
    values: tuple[Any, ...]


SWITCHES = (
    Switch("decimation", "range decimation", (1, 2, 4, 8, 16)),
    Switch("stride", "column stride", (1, 2, 3, 4, 6, 8)),
    Switch("step_mps", "velocity step, m/s", (0.025, 0.05, 0.1, 0.2, 0.4)),
    Switch("cpis", "velocity-time maps", (3, 2, 1)),
    Switch("source", "module sends", ("rf", "baseband")),
)
DECIMATIONS = (4, 8, 16)  # as shipped, and half and double of it
SETTINGS = tuple(MapSetting(decimation=d, cpis=c) for d in DECIMATIONS for c in (3, 2, 1))


@dataclass(frozen=True, slots=True)
class SwitchRow:
    """One value of one switch."""

    switch: str
    value: Any
    is_default: bool  # whether the shipped bundles have it there
    ms_per_hop: float  # CPU time in milliseconds: median over hops, best of the rounds
    ratio: float  # to the switch's finest value, in the same round; median over rounds
    loss_db: dict[str, float]  # by picture; 0 for the finest


@dataclass(frozen=True, slots=True, kw_only=True)
class Combination:
    """A bundle's network and what it is shown."""

    model: str
    setting: MapSetting
    map_ms: float  # CPU time of a hop from frames to maps
    network_ms: float
    auc: Estimate  # of windows, people against pets

    @property
    def ms_per_hop(self) -> float:
        """CPU time of both."""
        return self.map_ms + self.network_ms

    @property
    def is_shipped(self) -> bool:
        """Whether the bundle runs so."""
        return self.setting == MapSetting()


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
class JudgedWindows:
    """Windows in which a person or a pet is in view."""

    is_human: NDArray[np.bool_]
    passage: NDArray[np.int64]  # (n,): of which passage, counted from 0 without gaps
    maps: Mapping[Way, Columns]  # (n, rows, cells): bytes, 255 for 1


# ---------------------------------------------------------------- from frames to pictures


@dataclass(frozen=True, slots=True, kw_only=True)
class _StridedGrid(VelocityGrid):
    """A velocity-time map whose columns lie `stride` frames apart, whatever its cells."""

    stride: int

    def transform(self, dwell: Dwell, column_rate_hz: float | None = None) -> VelocityTransform:
        rate_hz = column_rate_hz or dwell.frame_rate_hz / self.stride
        return VelocityGrid.transform(self, dwell, rate_hz)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Strided(FeatureSettings):
    stride: int

    def velocity_grids(self) -> Mapping[str, VelocityGrid]:
        grids = FeatureSettings.velocity_grids(self)
        short = _StridedGrid(**asdict(grids["velocity_time"]), stride=self.stride)
        return {**grids, "velocity_time": short}


class Chain:
    """Down-conversion, clutter removal and maps of a stream, hop by hop; a hop is a second."""

    def __init__(self, axis: FastTimeAxis, frame_rate_hz: float, setting: MapSetting) -> None:
        self._converter = DownConverter(axis, setting.decimation)
        self._rate_hz = frame_rate_hz
        features = _Strided(
            velocity_cpi_s=0.2, velocity_step_mps=setting.step_mps, stride=setting.stride
        )
        names = (*MAP_FEATURES[: setting.cpis], "range_time")
        self._stream = FeatureStream(features, names)
        n_slow = round(features.dwell_s * frame_rate_hz) + round(CPI_S * frame_rate_hz) - 1
        self._rows = np.zeros((n_slow, self._converter.axis.n_range), np.complex64)
        self._remover = ClutterRemover()
        self._n_taken = 0

    def hop(self, samples: Samples) -> tuple[Dwell, Features] | None:
        """Return the dwell without its clutter and what it shows; None before it is whole."""
        n_new, n_slow = len(samples), len(self._rows)
        self._rows[:-n_new] = self._rows[n_new:]
        self._converter.convert(samples, self._rows[-n_new:])
        self._n_taken = n = self._n_taken + n_new
        if n < n_slow:
            return None
        valid, axis = np.ones(n_slow, np.bool_), self._converter.axis
        dwell = Dwell(self._rows, valid, axis, self._rate_hz, n / self._rate_hz, end_frame=n)
        moving = self._remover.remove(dwell)
        return moving, self._stream.extract(moving)


def record(scene: str, frame_rate_hz: float, duration_s: float, seed: int) -> Recording:
    """Simulate a scene as RF and as baseband; a lost frame repeats the one before."""
    frames: dict[str, Samples] = {}
    axes = {}
    for kind in ("rf", "baseband"):
        settings = port_settings(Port("sim", scene, {"rate": f"{frame_rate_hz:g}", "kind": kind}))
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
    """Measure switches on recordings, timed in rounds.

    The values of a switch take turns, so that a busy machine is busy for all.
    """
    open_hops = _some_open(recordings)
    rows: list[SwitchRow] = []
    done, total = 0, rounds * sum(len(switch.values) for switch in switches)
    for switch in switches:
        settings = [MapSetting(**{switch.name: value}) for value in switch.values]
        seconds: list[list[float]] = [[] for _ in settings]
        shows: list[list[Features]] = [[] for _ in settings]
        for _ in range(rounds):
            for k, setting in enumerate(settings):
                hops_s, shows[k] = _run(recordings, setting, open_hops)
                seconds[k].append(statistics.median(hops_s))
                done += 1
                tell(done, total)
        for k, (value, setting) in enumerate(zip(switch.values, settings, strict=True)):
            ratio = statistics.median(a / b for a, b in zip(seconds[k], seconds[0], strict=True))
            losses = _losses(shows[k], shows[0])
            ms, is_default = 1e3 * min(seconds[k]), setting == MapSetting()
            rows.append(SwitchRow(switch.name, value, is_default, ms, ratio, losses))
    return rows


def map_ms(
    recordings: Sequence[Recording], settings: Sequence[MapSetting], rounds: int, tell: Tell
) -> dict[MapSetting, float]:
    """Return the CPU time of a hop with an open gate, in ms of the best round, by setting."""
    open_hops = _some_open(recordings)
    least = dict.fromkeys(settings, np.inf)
    in_turn = [setting for _ in range(rounds) for setting in settings]
    for done, setting in enumerate(in_turn, 1):
        hops_s, _ = _run(recordings, setting, open_hops)
        least[setting] = min(least[setting], 1e3 * statistics.median(hops_s))
        tell(done, len(in_turn))
    return least


def picture_loss_db(
    ours: NDArray[np.float32], finest: NDArray[np.float32], depth_db: float
) -> float:
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


def _losses(ours: Sequence[Features], finest: Sequence[Features]) -> dict[str, float]:
    depth_db = {name: grid.depth_db for name, grid in FeatureSettings().velocity_grids().items()}
    depth_db["range_time"] = FeatureSettings().range_depth_db
    losses = {}
    for name in ours[0]:
        pairs = zip(ours, finest, strict=True)
        each_db = [picture_loss_db(a[name], b[name], depth_db[name]) for a, b in pairs]
        losses[name] = float(np.sqrt(np.mean(np.square(each_db))))
    return losses


def _run(
    recordings: Sequence[Recording], setting: MapSetting, open_hops: Sequence[Sequence[bool]]
) -> tuple[list[float], list[Features]]:
    """Return the CPU seconds of the hops with an open gate, and what they show."""
    hops_s, shows = [], []
    for recording, is_open in zip(recordings, open_hops, strict=True):
        chain = Chain(recording.axes[setting.source], recording.frame_rate_hz, setting)
        for k, samples in enumerate(recording.hops(setting.source)):
            started_s = time.thread_time()
            found = chain.hop(samples)
            taken_s = time.thread_time() - started_s
            if found is not None and is_open[k]:
                shows.append(found[1])
                hops_s.append(taken_s)
    return hops_s, shows


def _some_open(recordings: Sequence[Recording]) -> list[list[bool]]:
    """Return in which hops the daemon's gate is open, the first of each recording left out.

    Everything is made anew in the first dwell. Raises UsageError if the gate never opens.
    """
    open_hops = []
    for recording in recordings:
        chain = Chain(recording.axes["rf"], recording.frame_rate_hz, MapSetting())
        gate = Gate(GateSettings())
        found = [chain.hop(samples) for samples in recording.hops("rf")]
        is_open = [each is not None and gate.read(each[0]).is_open for each in found]
        if True in is_open:
            is_open[is_open.index(True)] = False
        open_hops.append(is_open)
    if not any(map(any, open_hops)):
        msg = "nothing moves in these scenes: the gate never opens"
        raise UsageError(msg)
    return open_hops


# ---------------------------------------------------------------- combinations


def check_combined(bundle: Bundle) -> None:
    """Raise UsageError if a bundle's network does not take maps alone."""
    if not {i.feature for i in bundle.inputs} <= {*MAP_FEATURES, INSTALLATION}:
        msg = f"model '{bundle.name}' takes more than maps and cannot be combined"
        raise UsageError(msg)


def judged_windows(
    n_passages: int, seed: int, bundles: Sequence[Bundle], tell: Tell
) -> JudgedWindows:
    """Play passages of people and pets once, and make their windows every way.

    Passage k is that of `train-export evaluate --radar thesis` with this seed; those of things and
    of empty rooms are passed over. The windows are the dwells with an open gate at every
    decimation. Raises UsageError if nobody is in view.
    """
    spec = JudgeSpec(model="", seed=seed, n_passages=n_passages, radar=RADAR)
    kinds = dict.fromkeys(bundle.features for bundle in bundles)
    ways = [(kind, d) for kind in kinds for d in DECIMATIONS]
    made: list[list[Columns]] = []
    for number in range(n_passages):
        cast = spec.suite(number).cast
        if cast and (cast[0] if isinstance(cast[0], str) else cast[0].label) != "other":
            made += _every_way(spec.played(number), ways, number)
        tell(number + 1, n_passages)
    if not made:
        msg = f"--passages {n_passages}: too few, nobody is in view"
        raise UsageError(msg)
    label = np.concatenate([each[0]["label"] for each in made])
    passage = np.repeat(np.arange(len(made)), [len(each[0]["label"]) for each in made])
    # At the rate of `RADAR`, of which nothing else is known.
    nothing = np.tile(installation(ONE_RADAR[RADAR].frame_rate_hz), (len(label), 1))
    maps = {
        way: {name: np.concatenate([each[k][name] for each in made]) for name in MAP_FEATURES}
        | {INSTALLATION: nothing}
        for k, way in enumerate(ways)
    }
    return JudgedWindows(label == _HUMAN, passage, maps)


def _every_way(passage: Passage, ways: Sequence[Way], number: int) -> list[list[Columns]]:
    """Return the windows of a passage, the same dwells in all ways; nothing if there are none."""
    made = [windows_of(_decimated(passage, d), kind, number) for kind, d in ways]
    columns = [each for each in made if each is not None]
    if len(columns) < len(ways):
        return []
    common = set.intersection(*(set(each["t_s"].tolist()) for each in columns))
    kept: list[Columns] = []
    for each in columns:
        is_kept = np.isin(each["t_s"], list(common)) & np.isin(each["label"], (_HUMAN, _PET))
        kept.append({key: values[is_kept] for key, values in each.items()})
    return [kept] if len(kept[0]["t_s"]) else []


def _decimated(passage: Passage, decimation: int) -> Passage:
    """Return what the daemon's ring would keep: every so many bins behind the matched filter."""
    radar = passage.site.radar
    frames = np.ascontiguousarray(passage.frames[:, ::decimation])
    bin_m = decimation * radar.bin_length_m
    far_m = radar.near_m + (frames.shape[1] - 1) * bin_m
    coarse = replace(radar, bin_length_m=bin_m, far_m=far_m)
    return replace(passage, site=replace(passage.site, radar=coarse), frames=frames)


def combinations(
    bundles: Sequence[Bundle],
    windows: JudgedWindows,
    costs_ms: Mapping[MapSetting, float],
    seed: int,
) -> list[Combination]:
    """Judge every bundle with each of `SETTINGS`.

    `costs_ms` is the CPU time of a hop without the network; `seed` is of the intervals.
    """
    made: list[Combination] = []
    for bundle in bundles:
        feed = {HIDDEN: np.zeros((1, bundle.n_hidden), np.float32)} if bundle.n_hidden else {}
        feed |= {i.name: np.zeros((1, *i.shape), np.float32) for i in bundle.inputs}
        session, took_s = session_of(bundle.onnx), []
        for _ in range(_CALLS):
            started_s = time.thread_time()
            session.run(None, feed)
            took_s.append(time.thread_time() - started_s)
        for setting in SETTINGS:
            maps = windows.maps[bundle.features, setting.decimation]
            blank = MAP_FEATURES[setting.cpis : 3]
            maps = {name: np.zeros_like(m) if name in blank else m for name, m in maps.items()}
            p = outputs_of(bundle.onnx, inputs_of(bundle, maps)).p(bundle.temperature)
            found = Combination(
                model=bundle.name,
                setting=setting,
                map_ms=costs_ms[setting],
                network_ms=1e3 * statistics.median(took_s),
                auc=_auc(p[:, bundle.classes.index(CLASSES[0])], windows, seed),
            )
            made.append(found)
    return made


def _auc(p_human: NDArray[np.float64], windows: JudgedWindows, seed: int) -> Estimate:
    with np.errstate(divide="ignore"):
        ranking = Ranking(np.log(p_human) - np.log1p(-p_human), windows.is_human)
    n_passages = int(windows.passage.max()) + 1
    rng = np.random.default_rng(seed)
    return resampled(lambda w: ranking.auc(w[windows.passage]), n_passages, rng, _REPLICATES)


def best(made: Sequence[Combination]) -> list[Combination]:
    """Return those of which none is both cheaper and better, the cheapest first."""
    front: list[Combination] = []
    for each in sorted(made, key=lambda c: (c.ms_per_hop, -c.auc.value)):
        if not front or each.auc.value > front[-1].auc.value:
            front.append(each)
    return front
