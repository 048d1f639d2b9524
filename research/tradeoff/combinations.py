"""Every combination of features, network, precision and decimation: its cost and accuracy.

A window goes to every network as its bundle wants it, at every decimation, with all of its
velocity-time maps or with the longer ones blank, in single precision and in int8. No network
is retrained: one that was made for what it is given here could do better.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from radard.judge.bundle import CLASSES, Bundle
from radard.judge.classifier import HIDDEN
from radard.judge.features import MAP_FEATURES, FeatureSettings
from radard.judge.installation import INSTALLATION
from research.tradeoff.maps import MapSetting
from research.tradeoff.windows import JudgedWindows, Maps
from x2train.bundle.network_cost import Feed, quantised, window_ms
from x2train.nets.bundle_answers import outputs_of
from x2train.report.intervals import Estimate, resampled
from x2train.report.ranking import Ranking

DECIMATIONS = (4, 8, 16)  # as shipped, and half and double of it
CPIS = (3, 2, 1)  # as shipped, and fewer
PRECISIONS = ("fp32", "int8")
SETTINGS = tuple(MapSetting(decimation=d, cpis=c) for d in DECIMATIONS for c in CPIS)
_LONGER = ("velocity_time_medium", "velocity_time_long")
_CALIBRATED_ON = 200  # windows: chosen
_CALLS = 200  # of which the median counts: chosen
_REPLICATES = 400  # chosen: more than reports, since rows are compared


@dataclass(frozen=True, slots=True, kw_only=True)
class Combination:
    """One of them."""

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


def check_combined(bundle: Bundle) -> None:
    """Raise UsageError if a bundle's network does not take maps alone."""
    if not {i.feature for i in bundle.inputs} <= {*MAP_FEATURES, INSTALLATION}:
        msg = f"model '{bundle.name}' takes more than maps and cannot be combined"
        raise UsageError(msg)


def combinations(
    bundles: list[Bundle],
    windows: JudgedWindows,
    others: JudgedWindows,
    chain_ms: Mapping[MapSetting, float],
    seed: int,
) -> Iterator[int | list[Combination]]:
    """Judge every combination; yield how many are done, then all.

    `windows`, at `DECIMATIONS`, judge; ranges of int8 are found on `others`, of other passages.
    `chain_ms` is the CPU time of a hop without the network, of `SETTINGS`; `seed` is of the
    intervals.
    """
    made: list[Combination] = []
    for bundle in bundles:
        rows = feeds(bundle, others.maps[bundle.features, MapSetting().decimation])
        nets = {"fp32": bundle.onnx, "int8": quantised(bundle.onnx, rows)}
        network_ms = window_ms({key: (net, rows[0]) for key, net in nets.items()}, _CALLS)
        for setting in SETTINGS:
            maps = _blanked(windows.maps[bundle.features, setting.decimation], setting.cpis)
            inputs = {i.name: maps[i.feature] for i in bundle.inputs}
            for precision, onnx_bytes in nets.items():
                answers = outputs_of(onnx_bytes, inputs)
                made.append(
                    Combination(
                        model=bundle.name,
                        precision=precision,
                        decimation=setting.decimation,
                        cpis=setting.cpis,
                        ms_per_hop=chain_ms[setting] + network_ms[precision],
                        network_ms=network_ms[precision],
                        auc=_auc(answers.p(bundle.temperature), bundle, windows, seed),
                    )
                )
                yield len(made)
    yield made


def n_combinations(n_bundles: int) -> int:
    """Return how far `combinations` counts."""
    return n_bundles * len(SETTINGS) * len(PRECISIONS)


def features_of(bundles: list[Bundle]) -> tuple[FeatureSettings, ...]:
    """Return the ways in which bundles want their maps, each once."""
    return tuple(dict.fromkeys(bundle.features for bundle in bundles))


def best(made: list[Combination]) -> list[Combination]:
    """Return those of which none is both cheaper and better, the cheapest first."""
    front: list[Combination] = []
    for each in sorted(made, key=lambda c: (c.ms_per_hop, -c.auc.value)):
        if not front or each.auc.value > front[-1].auc.value:
            front.append(each)
    return front


def _blanked(maps: Maps, cpis: int) -> Maps:
    blank = _LONGER[cpis - 1 :]
    return {name: np.zeros_like(m) if name in blank else m for name, m in maps.items()}


def feeds(bundle: Bundle, maps: Maps) -> list[Feed]:
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


def _auc(p: NDArray[np.float64], bundle: Bundle, windows: JudgedWindows, seed: int) -> Estimate:
    human = p[:, bundle.classes.index(CLASSES[0])]
    with np.errstate(divide="ignore"):
        ranking = Ranking(np.log(human) - np.log1p(-human), windows.is_human)
    n_passages = int(windows.passage.max()) + 1
    rng = np.random.default_rng(seed)
    return resampled(lambda w: ranking.auc(w[windows.passage]), n_passages, rng, _REPLICATES)
