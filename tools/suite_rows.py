"""Print docs/evaluation.md's tables by suite, as Markdown.

    python tools/suite_rows.py DIR [DIR ...]

Each DIR is what `train-export evaluate --out DIR` left, all on the same passages; the first
one's intervals and times are shown. Visits beyond those of the suites are left out.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from report_rows import asked, auc, missed_at, percent

from x2train.judge.estimates import Estimate, share
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import Verdicts, intrusions, verdicts
from x2train.sets.families import FAMILIES

Flags = NDArray[np.bool_]
VISITS = (0.05, 0.1, 0.15, 0.2, 0.25)


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A report's passages, and what came of them."""

    folder: Path
    table: PassageTable
    found: Verdicts

    @classmethod
    def of(cls, folder: Path) -> "Judged":
        """Read a folder, the passages of its suites."""
        table = PassageTable.load(folder / "passages")
        about = json.loads((folder / "passages" / "manifest.json").read_text())["about"]
        table = table.chosen(np.arange(len(table)) < about["n_passages"])
        return cls(folder, table, verdicts(table, table.is_alarm))

    def missed(self, chosen: Flags) -> tuple[int, int]:
        """Return how many intrusions were missed, and of how many."""
        people = chosen & intrusions(self.table)
        return int((people & ~self.found.is_alarm).sum()), int(people.sum())

    def loud(self, chosen: Flags) -> tuple[int, int]:
        """Return how many passages have a false alarm, and of how many."""
        return int((chosen & (self.found.false_alarms > 0)).sum()), int(chosen.sum())


def people_rows(judged: list[Judged]) -> Iterator[str]:
    """Yield the table of intrusions."""
    first = judged[0]
    table = first.table
    others = "".join(f" {each.folder.name} missed |" for each in judged[1:])
    yield f"| | intrusions | missed | median time to alarm |{others}"
    yield "|---|---|---|---|" + "---|" * (len(judged) - 1)
    chosen = {suite: table.suite == suite for suite in dict.fromkeys(table.suite.tolist())}
    chosen["**all**"] = np.ones(len(table), bool)
    for name, is_in in chosen.items():
        people = is_in & intrusions(table)
        if people.any():
            shown = (percent if name == "**all**" else short)(share(*first.missed(is_in)))
            after_s = float(np.median(first.found.alarm_s[people]))
            more = "".join(f" {short(share(*each.missed(is_in)))} |" for each in judged[1:])
            yield f"| {name} | {people.sum()} | {shown} | {after_s:.1f} s |{more}"


def quiet_rows(judged: list[Judged]) -> Iterator[str]:
    """Yield the table of passages in which nothing should raise an alarm."""
    table = judged[0].table
    yield "| | passages | with a false alarm |" + "".join(
        f" {each.folder.name} |" for each in judged[1:]
    )
    yield "|---|---|---|" + "---|" * (len(judged) - 1)
    is_quiet = ~np.isin(table.label, ["human"])
    chosen = {
        suite: table.suite == suite for suite in dict.fromkeys(table.suite[is_quiet].tolist())
    }
    chosen["**all visits of pets**"] = table.label == "pet"
    for name, is_in in chosen.items():
        shown = " | ".join(short(share(*each.loud(is_in))) for each in judged)
        yield f"| {name} | {is_in.sum()} | {shown} |"


def short(estimate: Estimate) -> str:
    """Return a share without its interval."""
    return f"{100 * estimate.value:.1f} %"


def told(judged: Judged) -> Iterator[str]:
    """Yield what else the page says of a bundle."""
    table, found = judged.table, judged.found
    report = json.loads((judged.folder / "report.json").read_text())
    windows = report["windows"]
    yield f"{report['title']}: window AUC {auc(windows['auc'])}, fused {auc(windows['auc_fused'])}"
    yield f"balanced accuracy {windows['balanced_accuracy']['value']:.3f}, reliability of the " + (
        f"fused value {report['reliability']['fused']['error']}"
    )
    visits = ", ".join(
        f"{at:.0%}: {missed_at(table, 'fused', at)} ({missed_at(table, 'window', at)})"
        for at in VISITS
    )
    yield f"missed where so many visits raise an alarm, fused (single windows): {visits}"
    open_in = np.zeros(len(table), bool)
    open_in[np.unique(table.passage[table.is_open])] = True
    missed = intrusions(table) & ~found.is_alarm
    yield f"{missed.sum()} missed, of which the gate never opened for {(missed & ~open_in).sum()}"
    loud, p_human = (table.label == "pet") & (found.false_alarms > 0), 1 - table.fused_quiet
    reasons = {"undecided": 0, "left undecided": 0, "for a person": 0}
    for k in np.flatnonzero(loud):
        rows = slice(table.first[k], table.first[k + 1])
        at = table.first[k] + int(np.argmax(table.is_alarm[rows]))
        of_person = "for a person" if p_human[at] >= 0.5 else "undecided"
        reasons[of_person if table.is_open[at] else "left undecided"] += 1
    yield "visits with an alarm, by what the evidence then was: " + str(reasons)
    stays = np.isin(table.family, [family.name for family in FAMILIES if family.stays])
    for animal in ("dog", "cat"):
        own = np.char.startswith(table.family, f"{animal} ") & (table.label == "pet")
        own &= np.char.find(table.family, " with ") < 0
        counts = [judged.loud(own & mask) for mask in (stays, ~stays)]
        yield f"{animal}s that stay {counts[0]}, that go {counts[1]} (with an alarm, of)"


def main() -> None:
    """Print the tables."""
    judged = [Judged.of(folder) for folder in asked(__doc__.partition("\n")[0])]
    lines = [*people_rows(judged), "", *quiet_rows(judged)]
    for each in judged:
        lines += ["", *told(each)]
    print("\n".join(lines))  # noqa: T201 - this is what it is for


if __name__ == "__main__":
    main()
