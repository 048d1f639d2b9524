"""Print docs/evaluation.md's table of bundles on the same passages, as Markdown.

    python tools/report_rows.py DIR [DIR ...]

Each DIR is what `train-export evaluate --out DIR` left. Fused bundles get a second row: what
their single windows would do at the same limit. The last columns move the limits of fused
evidence and of single windows to where so many of the pets' visits raise an alarm.
"""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from x2train.judge.estimates import Estimate, share
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import (
    PET_LIMIT,
    Policy,
    Sweep,
    Verdicts,
    evidence,
    intrusions,
    limit_evidence,
    verdicts,
)

EQUAL_SHARE = 0.2
"""Of the pets' visits with an alarm: about what the bundle `balanced` ships with."""
AT = f"missed at {EQUAL_SHARE:.0%} of visits"
HEAD = (
    *("bundle, policy", "intrusions missed", "pets' visits with an alarm", "things with one"),
    *("window AUC", "fused AUC", f"{AT}, fused", "windows"),
)


def percent(estimate: Estimate) -> str:
    """Return a share and its interval."""
    low, high = 100 * estimate.low, 100 * estimate.high
    return f"{100 * estimate.value:.1f} % ({low:.1f} to {high:.1f})"


def auc(raw: dict[str, Any]) -> str:
    """Return an AUC and its interval."""
    return f"{raw['value']:.3f} ({raw['low']:.3f} to {raw['high']:.3f})"


def missed_at(table: PassageTable, policy: Policy, visits_share: float = EQUAL_SHARE) -> str:
    """Return the share of intrusions that are missed where so many visits alarm."""
    sweep = Sweep.of(table, evidence(table, policy))
    visits = int((table.label == "pet").sum())
    # A visit lasts less than a minute, so it counts once at most.
    limit = sweep.limit_for(visits_share * visits / sweep.pet_hours)
    return f"{100 * float((sweep.intrusion < limit).mean()):.1f} %"


def counts(table: PassageTable, found: Verdicts) -> tuple[str, ...]:
    """Return intrusions missed, visits of pets with an alarm, things with one."""
    people, pets, things = intrusions(table), table.label == "pet", table.label == "other"
    n_missed = int((people & ~found.is_alarm).sum())
    loud = found.false_alarms > 0
    return (
        percent(share(n_missed, int(people.sum()))),
        percent(share(int((pets & loud).sum()), int(pets.sum()))),
        f"{int((things & loud).sum())} of {int(things.sum())}",
    )


def rows(folder: Path) -> Iterator[tuple[str, ...]]:
    """Yield the rows of one folder."""
    report = json.loads((folder / "report.json").read_text())
    table = PassageTable.load(folder / "passages")
    name, _, policy = report["title"].removeprefix("Bundle ").partition(", policy ")
    policy = policy.partition(",")[0]
    windows = report["windows"]
    at = (missed_at(table, "fused"), missed_at(table, "window"))
    ours = counts(table, verdicts(table, table.is_alarm))
    is_fused = policy == "fused"
    fused_auc = auc(windows["auc_fused"]) if is_fused else "-"
    yield (f"`{name}`, {policy}", *ours, auc(windows["auc"]), fused_auc, *at)
    if is_fused:
        single = evidence(table, "window") >= limit_evidence(PET_LIMIT)
        theirs = counts(table, verdicts(table, np.asarray(single)))
        yield (f"`{name}`, window", *theirs, *("as above",) * 4)


def asked(description: str) -> list[Path]:
    """Return the folders of the command line; one without a report is an error."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("folders", type=Path, nargs="+", metavar="DIR")
    folders: list[Path] = parser.parse_args().folders
    for folder in folders:
        if not (folder / "report.json").is_file():
            parser.error(f"{folder}: holds no report.json, as train-export evaluate --out leaves")
    return folders


def main() -> None:
    """Print the table."""
    folders = asked(__doc__.partition("\n")[0])
    about = json.loads((folders[0] / "passages" / "manifest.json").read_text())["about"]
    table = PassageTable.load(folders[0] / "passages")
    pets = table.label == "pet"
    table_rows: dict[str, tuple[str, ...]] = {}
    for folder in folders:
        for row in rows(folder):
            # A bundle's windows are the same in the folders of either policy.
            table_rows.setdefault(row[0], row)
    lines = [
        f"{len(table)} passages (seed {about['seed']}, --radar {about['radar']}): "
        f"{int(intrusions(table).sum())} intrusions, {int(pets.sum())} visits of pets, "
        f"{table.duration_s[pets].sum() / 3600:.1f} pet-hours",
        "",
        f"| {' | '.join(HEAD)} |",
        "|" + "---|" * len(HEAD),
        *(f"| {' | '.join(row)} |" for row in table_rows.values()),
    ]
    print("\n".join(lines))  # noqa: T201 - this is what it is for


if __name__ == "__main__":
    main()
