"""The report of a table of passages: report.json, versioned and with a schema, and report.html.

What is not known, or infinite, is null: a median time to alarm of null means that more
than half were missed, or that there was nobody. Figures have four digits.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from x2radar.atomic import write_whole
from x2radar.errors import WriteError
from x2train.judge.estimates import resampled
from x2train.judge.figures import Figures, figures
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import EPISODE_S, intrusions

VERSION = 1  # of the schema
_DIGITS = 4  # intervals are wider
_Bool = NDArray[np.bool_]
_Float = NDArray[np.float64]
_HOW = {
    "intrusion": "a person who was in the swath; missed without an alarm from then on",
    "false alarm": f"a minute ({EPISODE_S:g} s from a passage's first decision) with an alarm",
    "pet-hours": "how long the passages of pets last together, in the swath and out of it",
    "time to alarm": "from entering the swath, over all intrusions; infinite for a missed one",
    "limits for budgets": "chosen on these same passages",
    "intervals": (
        "95 %: Clopper-Pearson for shares, exact Poisson for rates (3/H after none in H hours), "
        "bootstrap by passage for the rest"
    ),
    "windows": "gate open, and the middle of the dwell in the time in the swath",
}
_SAME = ("label", "family", "duration_s", "enters_s", "leaves_s")


def write(
    table: PassageTable,
    out_dir: Path,
    *,
    title: str,
    other: PassageTable | None = None,
    render: Callable[[int], bytes] | None = None,
) -> dict[str, Any]:
    """Write report.json and report.html of a model into a folder; return what is in the JSON.

    `table` is what the model said of each passage, `other` what another one said of the same ones,
    to compare; `render` gives the picture of a passage, a PNG, for the worst twenty.
    Raises UsageError if `other` is of other passages, OutputError as `write_files`.
    """
    # Late: matplotlib takes a second, and a summary needs none.
    from x2train.judge.page import page  # noqa: PLC0415

    judged = {"this model": (table, figures(table))}
    here = judged["this model"][1]
    made = {"version": VERSION, "title": title, "how": _HOW, **_plain(here.content), "other": None}
    if other is not None:
        _check_same(table, other)
        there = figures(other)
        judged["other model"] = other, there
        whole = {k: v for k, v in there.content.items() if k not in {"groups", "worst"}}
        made["other"] = _plain({**whole, "pairings": pairings(table, here, there)})
    text = json.dumps(made, indent=1, allow_nan=False) + "\n"
    html = page(made, judged, render)
    write_files(out_dir, {"report.json": text, "report.html": html})
    return made


def write_files(out_dir: Path, texts: Mapping[str, str]) -> None:
    """Write a report's files; raises WriteError if the folder or one of them cannot be."""
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            write_whole(out_dir / name, text)
    except OSError as err:
        raise WriteError.of(out_dir, err) from err


def rounded(value: float) -> float:
    """Return a finite value with four digits; just below one, four of what is missing to it."""
    if 0.9 < value < 1:
        return float(f"{value:.{_DIGITS - 1 - math.floor(math.log10(1 - value))}f}")
    return float(f"{value:.{_DIGITS}g}")


def pairings(table: PassageTable, here: Figures, there: Figures) -> list[dict[str, Any]]:
    """Return who got wrong what the other model did not: as shipped, and each at its limit."""
    rng = np.random.default_rng(0)
    people, pets = intrusions(table), table.label == "pet"
    made = []
    for k, name in enumerate(("as shipped", "each at one false alarm in 60 pet-hours")):
        missed = [~f.found[k].is_alarm[people] for f in (here, there)]
        false = [f.found[k].false_alarms[pets] > 0 for f in (here, there)]
        difference = missed[0].astype(float) - missed[1]

        def mean(weight: _Float, d: _Float = difference) -> float:
            return float(weight @ d / weight.sum()) if len(d) else float("nan")

        less = resampled(mean, int(people.sum()), rng)
        pair = {"name": name, "missed": _overlap(*missed), "alarmed": _overlap(*false)}
        made.append({**pair, "miss_rate_less_other": less})
    return made


def _overlap(here: _Bool, there: _Bool) -> dict[str, int]:
    parts = {"both": here & there, "here": here & ~there, "there": ~here & there}
    return {name: int(part.sum()) for name, part in parts.items()}


def _check_same(table: PassageTable, other: PassageTable) -> None:
    """Raise UsageError unless both are of the same passages in the same order."""
    for name in _SAME:
        here, there = getattr(table, name), getattr(other, name)
        if not np.array_equal(here, there, equal_nan=here.dtype.kind == "f"):
            raise UsageError(f"the other model saw other passages: their {name} is not the same")


def _plain(value: Any) -> Any:
    """Return dataclasses as objects, floats rounded, and what is not finite as null."""
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(part) for part in value]
    if isinstance(value, float):
        return rounded(value) if math.isfinite(value) else None
    return value
