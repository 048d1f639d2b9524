"""The acceptance test as a task: bundles and functions on the same passages, one row each.

A function ``alarms(windows)`` of a file is a generator. It takes `radard.stream.ring.Dwell` after
`Dwell`, as the daemon's ring makes them, one a second with the last 2.45 s of frames, and yields
for each whether it is an alarm. It is given a window once it has answered the one before, so it
cannot look ahead.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmark_tasks import ENTRIES, entry_file, function_of, is_function, shipped, title_of
from radard.config.config import Config
from radard.config.sections import AUTO_MODEL
from radard.errors import UsageError
from radard.judge.decision import Decision
from radard.pipeline import Pipeline
from radard.stream.ring import Dwell
from study import Marks
from x2train.judge.acceptance import SETTINGS, VERSION, AcceptSpec, Setting, accept
from x2train.judge.acceptance_report import write_acceptance
from x2train.judge.estimates import per_hour, share
from x2train.sets.sites import Radar
from x2train.sets.workers import Crew, Tell

MARKS: Marks = (f"<!-- {VERSION} -->", f"<!-- end of {VERSION} -->")
Alarms = Callable[[Iterator[Dwell]], Iterator[bool]]
_WHOLE = 100  # from there on a rate is a whole number: two digits would not do


@dataclass(frozen=True, slots=True, kw_only=True)
class FunctionSpec(AcceptSpec):
    """An acceptance test of a function; `model` is FILE.py[:FUNCTION]."""

    @property
    def settings(self) -> tuple[Setting, ...]:
        """All of them."""
        return SETTINGS

    @property
    def files(self) -> dict[str, str]:
        """The hash of the file and of the function's name."""
        file, _, name = self.model.partition(":")
        return {self.model: hashlib.sha256(Path(file).read_bytes() + name.encode()).hexdigest()}

    def pipeline(self, radar: Radar, config: Config) -> Pipeline:
        """Return the daemon's gate with decisions whose alarm is the function's."""
        alarms: Any = function_of(self.model, "alarms")
        return FunctionPipeline(AlarmFunction(alarms, self.model), radar, config)


class FunctionPipeline(Pipeline):
    """The daemon's gate, and a function that decides behind it."""

    def __init__(self, function: "AlarmFunction", radar: Radar, config: Config) -> None:
        super().__init__(radar.stream(), config)
        self._function = function

    def decide(self, dwell: Dwell) -> Decision:
        """Decide as the function does, whatever the gate says."""
        return replace(super().decide(dwell), alarm=self._function.is_alarm(dwell))


class AlarmFunction:
    """A function's verdicts on one stream; `name` is that of the entry, for messages."""

    def __init__(self, alarms: Alarms, name: str) -> None:
        self._name = name
        self._waiting: list[Dwell] = []
        self._verdicts = iter(alarms(self._windows()))

    def _windows(self) -> Iterator[Dwell]:
        while True:
            if not self._waiting:
                msg = f"entry '{self._name}': took a window before it had answered the last one"
                raise UsageError(msg)
            yield self._waiting.pop()

    def is_alarm(self, window: Dwell) -> bool:
        """Return the verdict on the next window.

        Raises UsageError if the function ends, looks ahead or answers with anything but a bool.
        """
        self._waiting.append(window)
        verdict = next(self._verdicts, None)
        if not isinstance(verdict, bool | np.bool_) or self._waiting:
            msg = f"entry '{self._name}': must yield True or False for every window"
            raise UsageError(msg)
        return bool(verdict)


@dataclass(frozen=True, slots=True)
class AlarmEntrant:
    """One method."""

    title: str  # for people
    spec: type[AcceptSpec]
    model: str  # as the spec takes it


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
    file = entry_file(text)
    if Path(file).parent == ENTRIES and text not in shipped("alarms"):
        msg = f"entry '{text}': learns from a set's elements; {VERSION} takes bundles and alarms"
        raise UsageError(msg)
    if is_function(file):
        title = f"{title_of(file)} (`{Path(file.partition(':')[0]).stem}`)"
        return AlarmEntrant(title, FunctionSpec, file)
    spec = AcceptSpec(model=text)
    names = " and ".join(f"`{Path(name).stem}`" for name in spec.files)
    radars = {s.radar.name for s in spec.settings}
    part = f", {' and '.join(radars)} alone" if len(spec.settings) < len(SETTINGS) else ""
    return AlarmEntrant(f"bundle {names}{part}", AcceptSpec, text)


def play(
    entrant: AlarmEntrant, folder: Path, of_it: float, *, workers: int, tell: Tell
) -> AlarmScore:
    """Play a share of the test, or what is missing of it; the report lies in a folder below.

    Another file under the same name is another entry: nothing that is kept is taken for it.
    """
    spec = entrant.spec(model=entrant.model, share=of_it)
    told = json.dumps([sorted(spec.files.values()), of_it])
    digest = hashlib.sha256(told.encode()).hexdigest()[:12]
    out = folder / f"{VERSION}-{Path(entrant.model.partition(':')[0]).stem}-{digest}"
    # A function is known by its hash, wherever its file lies.
    known = {"model": "function"} if isinstance(spec, FunctionSpec) else {}
    table = accept(spec, out / "passages", Crew(workers, report=tell), **known)
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
            yield _row(score, "window", "the same, by single windows at 0.8")
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
    value, low, high = (100 * each for each in share(count, int(of)))
    return f"{count} of {of:.0f}: {value:.1f} % ({low:.1f} to {high:.1f})"


def _rate(count: int, hours: float) -> str:
    ends = per_hour(count, hours)
    value, low, high = (f"{x:.0f}" if x >= _WHOLE else f"{x:.2g}" for x in ends)
    return f"{value} ({low} to {high})"
