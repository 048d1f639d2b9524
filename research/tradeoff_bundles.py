"""What bundles cost and reach: a hop of the daemon, and every combination of what they are shown.

A window goes to every network as its bundle wants it, at every decimation, with all of its
velocity-time maps or with the longer ones blank, in single precision and in int8. No network
is retrained: one that was made for what it is given here could do better.
"""

import contextlib
import json
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.config.config import Config
from radard.errors import UsageError
from radard.judge.bundle import CLASSES, Bundle, load_bundle
from radard.judge.classifier import HIDDEN, Answer, Classifier, Hidden
from radard.judge.features import MAP_FEATURES, Features, FeatureSettings
from radard.judge.installation import INSTALLATION, installation
from radard.pipeline import Pipeline
from radard.stream.ring import Dwell
from tradeoff_chain import MapSetting, Recording
from x2radar.frame import Frame, StreamInfo
from x2train.bundle.network_cost import Feed, quantised, window_ms
from x2train.judge.estimates import Estimate, Ranking, resampled
from x2train.judge.judging import JudgeSpec
from x2train.nets.bundle_answers import outputs_of
from x2train.sets.families import LABELS
from x2train.sets.passages import Passage
from x2train.sets.sites import ONE_RADAR
from x2train.sets.windows import windows_of
from x2train.sets.workers import Tell

RADAR = "thesis"
"""An X2 with all its bins."""
PRECISIONS = ("fp32", "int8")
DECIMATIONS = (4, 8, 16)  # as shipped, and half and double of it
SETTINGS = tuple(MapSetting(decimation=d, cpis=c) for d in DECIMATIONS for c in (3, 2, 1))
_LONGER = ("velocity_time_medium", "velocity_time_long")
_CALIBRATED_ON = 200  # windows: ranges of activations no longer grow
_CALLS = 200  # of which the median counts
_REPLICATES = 400  # more than reports, since rows are compared
_HUMAN, _PET = LABELS.index("human"), LABELS.index("pet")
Columns = Mapping[str, NDArray[Any]]
Way = tuple[FeatureSettings, int]
"""How maps are made, and at which decimation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BundleRow:
    """What a bundle costs as the daemon runs it."""

    name: str
    # CPU time of a hop with an open gate, in milliseconds: down-conversion, clutter, gate,
    # tracks, features and network, of the dwell and of every track in it
    ms_per_hop: float
    network_ms: float  # the network's part of it
    accuracy: Estimate | None  # over windows, 0 to 1, of its evaluation


@dataclass(frozen=True, slots=True, kw_only=True)
class Combination:
    """A bundle's network in some precision, and what it is shown."""

    model: str
    precision: str  # of its network: 'fp32' or 'int8'
    decimation: int  # keep every so many range bins
    cpis: int  # velocity-time maps that are not blank
    ms_per_hop: float  # CPU time of frames to maps, and of the network
    network_ms: float
    auc: Estimate  # of windows, people against pets

    @property
    def is_shipped(self) -> bool:
        """Whether the bundle runs so."""
        default = MapSetting()
        shipped = (default.decimation, default.cpis, PRECISIONS[0])
        return (self.decimation, self.cpis, self.precision) == shipped


@dataclass(frozen=True, slots=True, eq=False)
class JudgedWindows:
    """Windows in which a person or a pet is in view."""

    is_human: NDArray[np.bool_]
    passage: NDArray[np.int64]  # (n,): of which passage, counted from 0 without gaps
    maps: Mapping[Way, Columns]  # (n, rows, cells): bytes, 255 for 1


def read_accuracy(path: Path) -> Estimate:
    """Return the accuracy over windows of a report.json; UsageError if the file is none."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))["windows"]["balanced_accuracy"]
        return Estimate(float(found["value"]), float(found["low"]), float(found["high"]))
    except (OSError, ValueError, TypeError, KeyError) as err:
        msg = f"{path}: no report.json of an evaluation ({err})"
        raise UsageError(msg) from err


def time_bundle(
    name: str, accuracy: Estimate | None, recordings: Sequence[Recording], rounds: int
) -> BundleRow:
    """Time a bundle on simulated scenes; the best of the rounds counts.

    Raises UsageError if nothing moves in them; BundleError and ModelMismatch are the bundle's.
    """
    bundle = load_bundle(name)
    hops_s, networks_s = [], []
    for _ in range(rounds):
        timed = [pair for r in recordings for pair in _timed(_TimedClassifier(bundle), r)]
        if not timed:
            msg = "nothing moves in these scenes: the gate never opens"
            raise UsageError(msg)
        hops_s.append(statistics.median(hop_s for hop_s, _ in timed))
        networks_s.append(statistics.median(network_s for _, network_s in timed))
    return BundleRow(
        name=bundle.name,
        ms_per_hop=1e3 * min(hops_s),
        network_ms=1e3 * min(networks_s),
        accuracy=accuracy,
    )


class _TimedClassifier(Classifier):
    """A classifier that adds up its CPU time."""

    used_s = 0.0

    def answer(self, features: Features, hidden: Hidden | None = None) -> Answer:
        started_s = time.thread_time()
        try:
            return super().answer(features, hidden)
        finally:
            self.used_s += time.thread_time() - started_s


def _timed(classifier: _TimedClassifier, recording: Recording) -> list[tuple[float, float]]:
    """Return the seconds of hops with an open gate, and of the network in them."""
    axis, frames = recording.axes["rf"], recording.frames["rf"]
    pipeline = Pipeline(StreamInfo(axis, recording.frame_rate_hz, ""), Config(), classifier)
    ring = pipeline.make_ring()
    timed = []
    hop_s = 0.0
    for k, samples in enumerate(frames):
        started_s = time.thread_time()
        ring.push(Frame(samples, k + 1, k, 0, False, axis))
        hop_s += time.thread_time() - started_s
        with contextlib.suppress(TimeoutError):
            dwell = ring.next_item(0)
            assert isinstance(dwell, Dwell)  # noqa: S101 - nothing else happens here
            classifier.used_s = 0.0
            started_s = time.thread_time()
            decision = pipeline.decide(dwell)
            hop_s += time.thread_time() - started_s
            # The first dwell is more than a hop.
            if decision.gate == "open" and decision.seq > 1:
                timed.append((hop_s, classifier.used_s))
            hop_s = 0.0
    return timed


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
    others: JudgedWindows,
    chain_ms: Mapping[MapSetting, float],
    seed: int,
) -> list[Combination]:
    """Judge every combination.

    `windows` judge; ranges of int8 are found on `others`, of other passages. `chain_ms` is the CPU
    time of a hop without the network, of `SETTINGS`; `seed` is of the intervals.
    """
    made: list[Combination] = []
    for bundle in bundles:
        rows = feeds(bundle, others.maps[bundle.features, MapSetting().decimation])
        nets = {"fp32": bundle.onnx, "int8": quantised(bundle.onnx, rows)}
        network_ms = window_ms({key: (net, rows[0]) for key, net in nets.items()}, _CALLS)
        for setting in SETTINGS:
            maps = windows.maps[bundle.features, setting.decimation]
            blank = _LONGER[setting.cpis - 1 :]
            maps = {name: np.zeros_like(m) if name in blank else m for name, m in maps.items()}
            inputs = {i.name: maps[i.feature] for i in bundle.inputs}
            for precision, onnx_bytes in nets.items():
                p = outputs_of(onnx_bytes, inputs).p(bundle.temperature)
                made.append(
                    Combination(
                        model=bundle.name,
                        precision=precision,
                        decimation=setting.decimation,
                        cpis=setting.cpis,
                        ms_per_hop=chain_ms[setting] + network_ms[precision],
                        network_ms=network_ms[precision],
                        auc=_auc(p[:, bundle.classes.index(CLASSES[0])], windows, seed),
                    )
                )
    return made


def feeds(bundle: Bundle, maps: Columns) -> list[Feed]:
    """Return some windows, evenly picked, as a bundle's network takes them one by one."""
    n = len(next(iter(maps.values())))
    picked = np.unique(np.linspace(0, n - 1, min(n, _CALIBRATED_ON)).astype(int))
    still = {HIDDEN: np.zeros((1, bundle.n_hidden), np.float32)} if bundle.n_hidden else {}
    inputs = {i.name: maps[i.feature][picked] for i in bundle.inputs}
    shown = {
        name: np.asarray(v / 255 if v.dtype == np.uint8 else v, np.float32)
        for name, v in inputs.items()
    }
    return [still | {name: m[k, None] for name, m in shown.items()} for k in range(len(picked))]


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
