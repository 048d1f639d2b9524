"""Scores to the tables of docs/benchmark.md, between its marks."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from radard.errors import UsageError
from x2train.studies.benchmark.scoring import Score
from x2train.studies.benchmark.tasks import FULL

Marks = tuple[str, str]
RESULTS: Marks = ("<!-- results -->", "<!-- end of results -->")
_NOT_RUN = "<!-- not run: minutes of simulation -->\n"


def table(scores: Sequence[Score]) -> Iterator[str]:
    """Yield the lines of the tables."""
    first = scores[0]
    size = f"{first.n_train} elements to train with, {first.n_test} fresh ones that judge"
    small = "" if first.n_train >= FULL else f"; **small: the full task has {FULL} of each**"
    yield f"Version `{first.version}`, {size}{small}."
    yield ""
    tasks = list(dict.fromkeys(s.task for s in scores))
    entries = dict.fromkeys((s.entry, s.title) for s in scores)
    yield f"| accuracy in per cent | {' | '.join(tasks)} | mean |"
    yield f"|---|{'---|' * (len(tasks) + 1)}"
    for entry, title in entries:
        own = {s.task: s for s in scores if s.entry == entry}
        cells = [f"{100 * own[task].accuracy:.1f}" if task in own else "" for task in tasks]
        mean = sum(s.accuracy for s in own.values()) / len(own)
        yield f"| {title} (`{entry}`) | {' | '.join(cells)} | {100 * mean:.1f} |"
    yield ""
    widest = max((s.high - s.low) / 2 for s in scores)
    yield f"The 95 % interval of each figure is at most ±{100 * widest:.1f} points (Wilson)."
    yield ""
    yield "| | mean AUC | mean cross-entropy, nats | mean accuracy of those in view |"
    yield "|---|---|---|---|"
    for entry, title in entries:
        own_scores = [s for s in scores if s.entry == entry]
        n = len(own_scores)
        auc = sum(s.auc for s in own_scores) / n
        entropy = sum(s.cross_entropy for s in own_scores) / n
        seen = sum(s.accuracy_in_view for s in own_scores) / n
        yield f"| {title} | {auc:.3f} | {entropy:.3f} | {100 * seen:.1f} |"


def publish(path: Path, marks: Marks, table_lines: Iterable[str], command: str) -> None:
    """Put tables and the command that made them into a page, in the place of those there.

    Raises UsageError if the page lacks the marks.
    """
    text = path.read_text("utf-8") if path.is_file() else ""
    before, begin, rest = text.partition(marks[0])
    _, end, behind = rest.partition(marks[1])
    if not begin or not end:
        msg = f"{path}: lacks the marks {marks[0]} and {marks[1]}"
        raise UsageError(msg)
    # The pages' tests heed the mark: results take minutes, or hours.
    lines = ("", "", _NOT_RUN, f"    {command}", "", *table_lines, "", "")
    body = "\n".join(lines)
    path.write_text(f"{before}{begin}{body}{end}{behind}", "utf-8")
