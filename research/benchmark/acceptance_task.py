"""The acceptance test as a task: bundles and functions on the same passages, one row each."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radard.config.sections import AUTO_MODEL
from radard.errors import UsageError
from research.benchmark import entries
from research.benchmark.entrants import shipped, title_of
from research.benchmark.results_page import Marks
from x2train.judge.acceptance import SETTINGS, VERSION, AcceptSpec, accept
from x2train.judge.acceptance_report import write_acceptance
from x2train.judge.alarm_function import is_function
from x2train.report.intervals import Estimate, per_hour, share
from x2train.sets.workers import Tell

MARKS: Marks = (f"<!-- {VERSION} -->", f"<!-- end of {VERSION} -->")
_WHOLE = 100  # from there on a rate is a whole number: two digits would not do
_RULE = "by single windows at 0.8"


@dataclass(frozen=True, slots=True)
class AlarmEntrant:
    """One method."""

    title: str
    """For people."""
    model: str
    """As `AcceptSpec` takes it."""


@dataclass(frozen=True, slots=True)
class AlarmScore:
    """What one method does: the acceptance report's content."""

    title: str
    share: float
    document: dict[str, Any]
    is_bundle: bool


def default_entries() -> tuple[str, ...]:
    """Return who enters if nobody is named: what ships, and the plain motion detector."""
    return (*shipped("alarms"), AUTO_MODEL, "balanced", "fast")


def alarm_entrant(text: str) -> AlarmEntrant:
    """Return what ``FILE.py[:FUNCTION]``, a bundle or an entry of this folder means.

    Raises UsageError for an entry that learns from elements; BundleError is a bundle's.
    """
    if text in shipped("alarms"):
        file = f"{Path(entries.__file__).parent / text}.py"
        return AlarmEntrant(f"{title_of(file)} (`{text}`)", file)
    if text in shipped():
        msg = f"entry '{text}': learns from a set's elements; {VERSION} takes bundles and alarms"
        raise UsageError(msg)
    if is_function(text):
        return AlarmEntrant(f"{title_of(text)} (`{Path(text.partition(':')[0]).stem}`)", text)
    spec = AcceptSpec(model=text)
    names = " and ".join(f"`{Path(name).stem}`" for name in spec.files)
    radars = {s.radar.name for s in spec.settings}
    part = f", {' and '.join(radars)} alone" if len(spec.settings) < len(SETTINGS) else ""
    return AlarmEntrant(f"bundle {names}{part}", text)


def play(
    entrant: AlarmEntrant, folder: Path, of_it: float, *, workers: int, tell: Tell
) -> AlarmScore:
    """Play a share of the test, or what is missing of it; the report lies in a folder below.

    Another file under the same name is another entry: nothing that is kept is taken for it.
    """
    spec = AcceptSpec(model=entrant.model, share=of_it)
    told = json.dumps([sorted(spec.files.values()), of_it])
    digest = hashlib.sha256(told.encode()).hexdigest()[:12]
    out = folder / f"{VERSION}-{Path(entrant.model.partition(':')[0]).stem}-{digest}"
    table = accept(spec, out / "passages", workers=workers, report=tell)
    about = {
        "version": spec.version,
        "bundle": entrant.title,
        "share": of_it,
        "seed": spec.seed,
        "words": f"{spec.version}: {of_it:.0%} of every entry's passages. Intervals hold 95 %.",
    }
    made = write_acceptance(table, out, about)
    return AlarmScore(entrant.title, of_it, made, not is_function(entrant.model))


def alarm_table(scores: Sequence[AlarmScore]) -> Iterator[str]:
    """Yield the lines of the table."""
    of_it = scores[0].share
    small = "" if of_it == 1 else f"; **a share of {of_it:g} of the test**"
    yield f"Version `{VERSION}`{small}."
    yield ""
    yield (
        "| | walk tests missed | crossings of pets with an alarm | alarms in an hour of pets that "
        "stay | alarms in an hour of things |"
    )
    yield "|---|---|---|---|---|"
    for score in scores:
        yield _row(score, "bundle", score.title)
        if score.is_bundle:
            yield _row(score, "window", f"the same, {_RULE}")
    yield ""
    yield "Brackets hold 95 % (Clopper-Pearson; exact Poisson for rates)."


def _row(score: AlarmScore, policy: str, title: str) -> str:
    cells = [
        _share(*_sum(score, "walk test", policy)),
        _share(*_sum(score, "pets cross", policy)),
        _rate(*_sum(score, "pets stay", policy)),
        _rate(*_sum(score, "thing", policy)),
    ]
    return f"| {title} | {' | '.join(cells)} |"


def _sum(score: AlarmScore, kind: str, policy: str) -> tuple[int, float]:
    rows = [row[policy] for row in score.document["entries"] if row["kind"] == kind]
    return sum(row["count"] for row in rows), sum(row["of"] for row in rows)


def _share(count: int, of: float) -> str:
    made: Estimate = share(count, int(of))
    value, low, high = (100 * each for each in (made.value, made.low, made.high))
    return f"{count} of {of:.0f}: {value:.1f} % ({low:.1f} to {high:.1f})"


def _rate(count: int, hours: float) -> str:
    made = per_hour(count, hours)
    ends = (made.value, made.low, made.high)
    value, low, high = (f"{x:.0f}" if x >= _WHOLE else f"{x:.2g}" for x in ends)
    return f"{value} ({low} to {high})"
