"""Scores to the tables of docs/benchmark.md, between its marks."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from radard.errors import UsageError
from research.benchmark.scoring import Score
from research.benchmark.tasks import FULL

Marks = tuple[str, str]
RESULTS: Marks = ("<!-- results -->", "<!-- end of results -->")
_NOT_RUN = "<!-- not run: minutes of simulation -->\n"


def table(scores: Sequence[Score]) -> Iterator[str]:
    """Yield the lines of the tables."""
    most = max(_size(s) for s in scores)
    size = f"{most[0]} elements to train with, {most[1]} fresh ones that judge"
    small = "" if most[0] >= FULL else f"; **small: the full task has {FULL} of each**"
    yield f"Version `{scores[0].version}`, {size}{small}."
    yield ""
    tasks = list(dict.fromkeys(s.task for s in scores))
    entries = dict.fromkeys((s.entry, s.title) for s in scores)
    yield f"| accuracy in per cent | {' | '.join(tasks)} | mean |"
    yield f"|---|{'---|' * (len(tasks) + 1)}"
    for entry, title in entries:
        own = {s.task: s for s in scores if s.entry == entry}
        cells = [f"{100 * own[task].accuracy:.1f}" if task in own else "" for task in tasks]
        mean = sum(s.accuracy for s in own.values()) / len(own)
        its = _size(next(iter(own.values())))
        less = "" if its == most else f", with {its[0]} and {its[1]} elements"
        yield f"| {title} (`{entry}`){less} | {' | '.join(cells)} | {100 * mean:.1f} |"
    yield ""
    widths = {
        n: max((s.high - s.low) / 2 for s in scores if s.n_test == n)
        for n in sorted({s.n_test for s in scores}, reverse=True)
    }
    told = ", ".join(f"±{100 * widest:.1f} points with {n}" for n, widest in widths.items())
    yield f"The 95 % interval of each figure is at most {told} that judge (Wilson)."
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


def _size(score: Score) -> tuple[int, int]:
    return score.n_train, score.n_test


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
