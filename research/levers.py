"""What each setting costs in misses, false alarms, time and CPU: `docs/tradeoff.md`.

People and pets go through drawn rooms as in the acceptance test: cross sections follow from sizes,
every motion and skin, no domain randomization. A case changes one setting and leaves the others as
usual; passage k is drawn alike in every case, and judged by the daemon's own pipeline.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from radard.config.config import Config
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.pipeline import Pipeline
from x2radar.frame import StreamInfo
from x2radar.sim.bodies.motion import MOTIONS
from x2radar.sim.bodies.skins import SKINS
from x2radar.sim.points import Label
from x2train.judge.acceptance import Setting, site_of
from x2train.judge.estimates import Estimate, share
from x2train.judge.judging import KNOWS, Knows, dwells, from_decisions, in_view, installed
from x2train.judge.table import Columns, PassageTable
from x2train.judge.verdicts import verdicts
from x2train.sets.families import draw_goer
from x2train.sets.passages import BodyModel, Passage, play
from x2train.sets.sites import X2
from x2train.sets.workers import Tell

USUAL = Setting(X2, "1.2 m, level", 1.2, 0.0, 3.0)
"""The lower of the acceptance test's mounts."""
_MOUNTS = (
    Setting(X2, "0.6 m, level", 0.6, 0.0, 3.0),
    USUAL,
    Setting(X2, "2.2 m, 23 degrees down", 2.2, 23.0, 2.7),
    Setting(X2, "ceiling, 2.6 m, 60 degrees down", 2.6, 60.0, 2.0),
)
_RATES_HZ = (30.0, 60.0, 100.0, 200.0)
_WITHIN_S = (0.0, 3.0, 5.0, 8.0)
_HOPS_S = (0.5, 1.0, 2.0)
MODELS = ("accurate", "balanced", "fast")
"""Bundles; the first is the usual one."""
_SEED = 70  # of no other suite
_LASTS_S: dict[Label, float] = {"human": 14.0, "pet": 20.0}  # as visits of the acceptance test
_LEAD_S = (2.6, 4.0)
_BYTES = 8  # of a sample on the line: I and Q, four bytes each


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One row of the table."""

    lever: str
    value: str
    setting: Setting = USUAL
    model: str
    within_s: float = 3.0  # `decision.decide_within_s`
    hop_s: float = 1.0
    knows: Knows = "nothing"  # of the installation
    is_usual: bool = False  # nothing is changed


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


def cases(models: tuple[str, ...]) -> Iterator[Case]:
    """Yield every case; the first of the models is the usual one."""
    unchanged = Case(lever="", value="", model=models[0])
    for case in _cases(models):
        yield replace(case, is_usual=replace(case, lever="", value="") == unchanged)


def _cases(models: tuple[str, ...]) -> Iterator[Case]:
    usual = models[0]
    for rate_hz in _RATES_HZ:
        setting = replace(USUAL, radar=replace(X2, frame_rate_hz=rate_hz))
        yield Case(lever="frame rate", value=f"{rate_hz:g} Hz", setting=setting, model=usual)
    for setting in _MOUNTS:
        yield Case(lever="mount", value=setting.mount, setting=setting, model=usual)
    for model in models:
        yield Case(lever="bundle", value=model, model=model)
    for s in _WITHIN_S:
        yield Case(lever="`decide_within_s`", value=f"{s:g} s", model=usual, within_s=s)
    for s in _HOPS_S:
        yield Case(lever="hop", value=f"{s:g} s", model=usual, hop_s=s)
    for known in KNOWS:
        yield Case(lever="what `mount` says", value=known, model=usual, knows=known)


def measure(rows: Sequence[Case], n: int, tell: Tell) -> tuple[Figures, ...]:
    """Return what every case does to `n` people and `n` pets.

    Cases with the same radar and mount share what is simulated.
    """
    made: dict[Case, list[Columns]] = {case: [] for case in rows}
    cpu_s, stream_s = dict.fromkeys(rows, 0.0), dict.fromkeys(rows, 1e-9)
    settings = tuple(dict.fromkeys(case.setting for case in rows))
    total = len(settings) * len(_LASTS_S) * n
    played = ((s, label, k) for s in settings for label in _LASTS_S for k in range(n))
    for done, (setting, label, k) in enumerate(played, 1):
        passage = _played(setting, label, k)
        for case in (case for case in rows if case.setting == setting):
            judged, taken_s, lasted_s = _judged(case, passage, k)
            made[case].append(judged)
            cpu_s[case] += taken_s
            stream_s[case] += lasted_s
        tell(done, total)
    return tuple(
        _figures(case, PassageTable.of(made[case]), 1e3 * cpu_s[case] / stream_s[case])
        for case in rows
    )


def _played(setting: Setting, label: Label, k: int) -> Passage:
    rng = np.random.default_rng([_SEED, tuple(_LASTS_S).index(label), k])
    site = site_of(rng, setting)
    body_model = BodyModel.draw(rng, MOTIONS, tuple(SKINS), 1.0)
    cast = (draw_goer(rng, label, "train"),)
    lasts_s = _LASTS_S[label]
    return play(
        rng, site, cast, duration_s=lasts_s, lead_s=_LEAD_S, is_plain=True, body_model=body_model
    )


@lru_cache(maxsize=8)
def classifier(model: str) -> Classifier:
    """Return what judges by a bundle; one for all rows."""
    return Classifier(load_bundle(model))


def config_of(case: Case) -> Config:
    """Return a case's configuration, without what it knows of the installation."""
    config = Config()
    asked = {"decide_within_s": case.within_s, "hop_s": case.hop_s}
    decision = config.decision.model_copy(update=asked)
    return config.model_copy(update={"decision": decision})


def _judged(case: Case, played: Passage, k: int) -> tuple[Columns, float, float]:
    """Return a judged passage, CPU time with the gate open, and for how much of the stream."""
    config = installed(config_of(case), played.site, case.knows, np.random.default_rng([_SEED, k]))
    radar = played.site.radar
    stream = StreamInfo(radar.axis(), radar.frame_rate_hz, radar.name)
    pipeline = Pipeline(stream, config, classifier(case.model), judges_tracks=False)
    made, taken_s, lasted_s = [], 0.0, 0.0
    for dwell in dwells(pipeline, played.frames, radar.axis()):
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


def table(figures: Sequence[Figures], n: int) -> Iterator[str]:
    """Yield the lines of the table; what is usual is bold."""
    yield f"{n} people and {n} visits of pets in every row; intervals hold 95 %."
    yield ""
    yield (
        "| lever | value | people missed, % | pets' visits with an alarm, % | alarm after, "
        "half / 90 % | ms a second | KiB/s |"
    )
    yield "|---|---|---|---|---|---|---|"
    for f in figures:
        value = f"**{f.case.value}**" if f.case.is_usual else f.case.value
        times = " / ".join(f"{s:.1f} s" if s < np.inf else "never" for s in (f.median_s, f.slow_s))
        shares = " | ".join(
            f"{100 * e.value:.1f} ({100 * e.low:.1f} to {100 * e.high:.1f})"
            for e in (f.missed, f.pets)
        )
        costs = f"{f.cpu_ms:.1f} | {f.kib_per_s:.0f}"
        yield f"| {f.case.lever} | {value} | {shares} | {times} | {costs} |"


def drawn(figures: Sequence[Figures]) -> Figure:
    """Draw what each value does to misses and to pets' alarms, a row each, with 95 % intervals."""
    figure = Figure(figsize=(9, 0.8 + 0.3 * len(figures)), layout="constrained")
    of_people, of_pets = figure.subplots(1, 2, sharey=True, width_ratios=(1, 2))
    for row, f in enumerate(figures):
        colour = "C1" if f.case.is_usual else "C0"
        for ax, e in ((of_people, f.missed), (of_pets, f.pets)):
            ax.plot([100 * e.low, 100 * e.high], [row, row], color=colour, alpha=0.4, lw=3)
            ax.plot(100 * e.value, row, "o", color=colour)
    levers = [f.case.lever.replace("`", "") for f in figures]
    for ax, title in ((of_people, "people missed, %"), (of_pets, "pets' visits with an alarm, %")):
        ax.set(title=title, xlim=(0, None))
        ax.grid(axis="x", alpha=0.3)
        for row in range(1, len(figures)):
            if levers[row] != levers[row - 1]:
                ax.axhline(row - 0.5, color="0.6", lw=0.8)
    names = [f"{lever}:  {f.case.value}" for lever, f in zip(levers, figures, strict=True)]
    of_people.set_yticks(range(len(figures)), names)
    of_people.invert_yaxis()
    return figure
