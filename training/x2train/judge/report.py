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

from radard.errors import OutputError
from x2train.judge.compare import Pairing, check_same, pairings
from x2train.judge.figures import Figures, figures
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import EPISODE_S

VERSION = 1  # of the schema
_DIGITS = 4  # intervals are wider
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


def write(
    table: PassageTable,
    out_dir: Path,
    *,
    title: str,
    other: PassageTable | None = None,
    render: Callable[[int], bytes | None] | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Write report.json and report.html of a model into a folder; return what is in the JSON.

    Parameters
    ----------
    table, other : PassageTable
        What the model said of each passage; what another one said of the same ones, to compare.
    out_dir, title : Path and str
        The folder, made when missing; headline of the page.
    render : callable, optional
        Index of a passage to its picture, a PNG, or None; asked for the worst twenty.
    seed : int
        Of the draws for the intervals.

    Returns
    -------
    dict
        As report.schema.json describes.

    Raises
    ------
    UsageError
        If `other` is of other passages.
    OutputError
        If the folder or a file cannot be written.
    """
    # Late: matplotlib takes a second, and a summary needs none.
    from x2train.judge.page import page  # noqa: PLC0415

    here = figures(table, seed)
    there: Figures | None = None
    pairs: tuple[Pairing, ...] = ()
    if other is not None:
        check_same(table, other)
        there = figures(other, seed)
        pairs = pairings(table, here, there, seed)
    made = document(title, table, here, there, pairs)
    text = json.dumps(made, indent=1, allow_nan=False) + "\n"
    html = page(
        made, table, here, None if other is None or there is None else (other, there), render
    )
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
        (out_dir / "report.json").write_text(text, encoding="utf-8")
        (out_dir / "report.html").write_text(html, encoding="utf-8")
    except OSError as err:
        msg = f"{out_dir}: cannot write the report: {err.strerror}"
        raise OutputError(msg) from err
    return made


def document(
    title: str,
    table: PassageTable,
    here: Figures,
    there: Figures | None,
    pairs: tuple[Pairing, ...],
) -> dict[str, Any]:
    """Return the report as JSON can hold it; report.schema.json describes it."""
    made = {
        "version": VERSION,
        "title": title,
        "how": _HOW,
        **_plain(_of(here)),
        "worst": [_plain(_worst(table, here, k)) for k in range(len(here.worst))],
        "other": None,
    }
    if there is not None:
        made["other"] = {**_plain(_of(there)), "pairings": [_plain(pair) for pair in pairs]}
        made["other"].pop("groups")
    return made


def rounded(value: float) -> float:
    """Return a finite value with four digits; just below one, four of what is missing to it."""
    if 0.9 < value < 1:
        return float(f"{value:.{_DIGITS - 1 - math.floor(math.log10(1 - value))}f}")
    return float(f"{value:.{_DIGITS}g}")


def _of(here: Figures) -> dict[str, Any]:
    return {
        "passages": here.n_passages,
        "pet_hours_in_swath": here.pet_hours_in_swath,
        "never_in_swath": here.n_never_in_swath,
        "invalid_windows": here.n_invalid,
        "operating_points": here.points,
        "sweep_agreement": here.agreement,
        "windows": here.windows,
        "is_matched": here.is_matched,
        "baselines": here.baselines,
        "reliability": here.reliability,
        "groups": here.groups,
    }


def _worst(table: PassageTable, here: Figures, rank: int) -> dict[str, Any]:
    case = here.worst[rank]
    names = ("family", "label", "split", "suite", "build", "speed_mps", "range_m", "aspect_deg")
    facts = {name: getattr(table, name)[case.index].item() for name in (*names, "snr_db")}
    alarm_s = float(here.found[0].alarm_s[case.index])
    return {
        "index": case.index,
        **facts,
        "is_wrong": case.is_wrong,
        "margin": case.margin,
        "alarm_s": alarm_s,
    }


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
