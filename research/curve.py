"""People missed against pets with an alarm, so many seconds after they came, and the default.

Of passages that were judged before, by `train-export accept` or `evaluate`: each counts with the
most evidence that there was until then, undecided or not.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from study import run_script, say, script_parser
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import verdicts

WITHIN_S = (2.0, 3.0, 5.0, 8.0)
SHARES = (0.05, 0.1, 0.2)  # of pets with an alarm
_LONG_S = 60.0  # pets that stay for longer have many alarms: what counts there is a rate
_Float = NDArray[np.float64]


def main(argv: Sequence[str] | None = None) -> int:
    """Print a row for every time, of every folder."""
    parser = script_parser(
        "curve", "Trade people missed for pets with an alarm.", "accept/shipped report/accurate"
    )
    parser.add_argument("folder", type=Path, nargs="+", help="of train-export accept or evaluate")
    parser.add_argument("--only", metavar="TEXT", help="splits that begin so")
    return run_script(parser, _run, argv)


def _run(args: argparse.Namespace) -> None:
    shares = " | ".join(f"{share:.0%}" for share in SHARES)
    say(f"| | within | people missed; pets with an alarm | missed where so many pets: {shares} |")
    say(f"|---|---|---|{'---|' * len(SHARES)}")
    for folder in args.folder:
        table = PassageTable.load(folder / "passages")
        begins = np.char.startswith(table.split, args.only or "")
        table = table.chosen(begins & (table.duration_s <= _LONG_S))
        for row in _rows(table, str(folder)):
            say(row)


def _rows(table: PassageTable, name: str) -> Iterator[str]:
    people = (table.label == "human") & np.isfinite(table.enters_s)
    pets = table.label == "pet"
    if not people.any() or not pets.any():
        raise UsageError(f"{name}: needs people and pets, of {_LONG_S:g} s at most")
    alarm_s = verdicts(table, table.is_alarm).alarm_s
    for within_s in WITHIN_S:
        most = _most_evidence(table, within_s)
        missed = int((alarm_s[people] > within_s).sum())
        alarms = int((alarm_s[pets] <= within_s).sum())
        told = f"{_of(missed, people)}; {_of(alarms, pets)}"
        cells = " | ".join(f"{_missed_at(share, most[people], most[pets])}" for share in SHARES)
        yield f"| {name} | {within_s:g} s | {told} | {cells} |"


def _most_evidence(table: PassageTable, within_s: float) -> _Float:
    """Return the most evidence of each passage until so long after the body came."""
    quiet = np.clip(table.fused_quiet, 1e-300, 1 - 1e-16)
    score = np.where(table.is_open & np.isfinite(quiet), np.log1p(-quiet) - np.log(quiet), -np.inf)
    since_s = table.t_s - np.nan_to_num(table.enters_s)[table.passage]
    counts = (since_s >= 0) & (since_s <= within_s)
    most = np.full(len(table), -np.inf)
    np.maximum.at(most, table.passage[counts], score[counts])
    return most


def _missed_at(share: float, people: _Float, pets: _Float) -> str:
    """Return how many people are missed by the limit that lets so many pets alarm."""
    limit = np.sort(pets)[::-1][int(share * len(pets))]  # above it there are no more than these
    return f"{np.mean(people <= max(limit, -1e300)):.1%}"


def _of(count: int, chosen: NDArray[np.bool_]) -> str:
    return f"{count / chosen.sum():.1%}"


if __name__ == "__main__":
    sys.exit(main())
