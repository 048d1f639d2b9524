"""Every case judged on the same people and pets, in the daemon's own pipeline.

People and pets go through drawn rooms as in the acceptance test: cross sections follow from sizes,
every motion and skin, no domain randomization. Passage k is drawn alike in every case.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from radard.config.config import Config
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.pipeline import Pipeline
from research.levers.cases import Case
from x2radar.frame import StreamInfo
from x2radar.sim.bodies.motion.curves import MOTIONS
from x2radar.sim.bodies.skin.draw import SKINS
from x2train.judge.acceptance import Setting, site_of
from x2train.judge.installed import installed
from x2train.judge.judging import dwells, from_decisions, in_view
from x2train.report import JudgedPassage, PassageTable
from x2train.report.intervals import Estimate, share
from x2train.report.verdicts import verdicts
from x2train.sets.families import draw_goer
from x2train.sets.passages import Making, Passage, play

_SEED = 70  # of no other suite: chosen
_LASTS_S = {"human": 14.0, "pet": 20.0}  # as walk tests and visits of the acceptance test
_LEAD_S = (2.6, 4.0)
_BYTES = 8  # of a sample on the line: I and Q, four bytes each


@dataclass(frozen=True, slots=True)
class Figures:
    """What a case does."""

    case: Case
    missed: Estimate  # share of the people in view without an alarm
    pets: Estimate  # share of the pets' visits with an alarm
    median_s: float  # from coming into view to the alarm; infinite if most are missed
    slow_s: float  # nine in ten alarm within it
    cpu_ms: float  # of decisions with an open gate, a second of stream
    kib_per_s: float  # of baseband, as this swath is made


def measure(cases: Sequence[Case], n: int) -> Iterator[int | tuple[Figures, ...]]:
    """Judge `n` people and `n` pets in every case; yield how many were played, then the figures.

    Cases with the same radar and mount share what is simulated.
    """
    made: dict[int, list[JudgedPassage]] = {k: [] for k in range(len(cases))}
    cpu_s = np.zeros(len(cases))
    stream_s = np.zeros(len(cases))
    done = 0
    for setting in dict.fromkeys(case.setting for case in cases):
        for label in _LASTS_S:
            for k in range(n):
                played = _played(setting, label, k)
                for at, case in enumerate(cases):
                    if case.setting != setting:
                        continue
                    passage, taken_s, lasted_s = _judged(case, played, k)
                    made[at].append(passage)
                    cpu_s[at] += taken_s
                    stream_s[at] += lasted_s
                done += 1
                yield done
    yield tuple(
        _figures(case, PassageTable.of(made[at]), 1e3 * cpu_s[at] / max(stream_s[at], 1e-9))
        for at, case in enumerate(cases)
    )


def n_played(cases: Sequence[Case], n: int) -> int:
    """Return how many passages `measure` plays."""
    return len({case.setting for case in cases}) * len(_LASTS_S) * n


def _played(setting: Setting, label: str, k: int) -> Passage:
    rng = np.random.default_rng([_SEED, tuple(_LASTS_S).index(label), k])
    site = site_of(rng, setting)
    making = Making.draw(rng, MOTIONS, tuple(SKINS), 1.0)
    who: Literal["human", "pet"] = "human" if label == "human" else "pet"
    cast = (draw_goer(rng, who, "train"),)
    return play(
        rng,
        site,
        cast,
        duration_s=_LASTS_S[label],
        lead_s=_LEAD_S,
        is_plain=True,
        making=making,
    )


@lru_cache(maxsize=8)
def _classifier(model: str) -> Classifier:
    return Classifier(load_bundle(model))


def _judged(case: Case, played: Passage, k: int) -> tuple[JudgedPassage, float, float]:
    """Return a judged passage, CPU time with the gate open, and for how much of the stream."""
    radar = played.site.radar
    stream = StreamInfo(radar.axis(), radar.frame_rate_hz, radar.name)
    pipeline = Pipeline(
        stream,
        _config(case, played, k),
        _classifier(case.model),
        judges_tracks=False,
        hop_s=case.hop_s,
    )
    made, taken_s, lasted_s = [], 0.0, 0.0
    for dwell in dwells(pipeline, played):
        began_s = time.process_time()
        made.append(pipeline.decide(dwell))
        if made[-1].gate == "open":
            taken_s += time.process_time() - began_s
            lasted_s += case.hop_s
    passage = from_decisions(
        made,
        family=played.cast[0].name,
        label=played.cast[0].label,
        duration_s=len(played.frames) / radar.frame_rate_hz,
        **in_view(played),
    )
    return passage, taken_s, lasted_s


def _config(case: Case, played: Passage, k: int) -> Config:
    config = Config()
    decision = config.decision.model_copy(update={"decide_within_s": case.within_s})
    config = config.model_copy(update={"decision": decision})
    return installed(config, played.site, case.knows, np.random.default_rng([_SEED, k]))


def _figures(case: Case, table: PassageTable, cpu_ms: float) -> Figures:
    made = verdicts(table, table.is_alarm)
    people = (table.label == "human") & np.isfinite(table.enters_s)
    pets = table.label == "pet"
    taken_s = np.sort(made.alarm_s[people])
    radar = case.setting.radar
    return Figures(
        case,
        share(int(np.isinf(taken_s).sum()), len(taken_s)),
        share(int((made.false_alarms[pets] > 0).sum()), int(pets.sum())),
        _quantile(taken_s, 0.5),
        _quantile(taken_s, 0.9),
        cpu_ms,
        radar.axis().n_range * radar.frame_rate_hz * _BYTES / 1024,
    )


def _quantile(taken_s: NDArray[np.float64], level: float) -> float:
    if not len(taken_s):
        return float("nan")
    return float(taken_s[min(int(level * len(taken_s)), len(taken_s) - 1)])
