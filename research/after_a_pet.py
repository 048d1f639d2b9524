"""What it costs people that an alarm remembers a pet: the walk tests again, each behind one.

Every person of an acceptance test's walk tests is judged by the evidence of the first stay, as it
was, and as if a pet that was known for sure had stopped there so many seconds before. How many
enter within reach of where a pet stopped follows from where the test's pets stop.
"""

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from radard.judge.bundle import EvidenceSettings, load_bundle
from radard.judge.classifier import Answer, Probabilities
from radard.judge.decision import Verdict
from radard.judge.evidence import NEAR_M, Evidence
from study import run_script, say, script_parser
from x2train.judge.acceptance import ENTRIES
from x2train.judge.table import PassageTable

GAPS_S = (2.0, 10.0, 30.0, 60.0)
_PET = Probabilities(0.001, 0.998, 0.001)
_WITHIN_S = 3.0  # decision.decide_within_s
_KINDS = {entry.name: entry.kind for entry in ENTRIES}


def main(argv: Sequence[str] | None = None) -> int:
    """Print how many walk tests are missed with and without a pet before them."""
    parser = script_parser(
        "after_a_pet", "Judge walk tests behind a pet that stopped.", "accept/shipped"
    )
    parser.add_argument("folder", type=Path, help="of train-export accept")
    parser.add_argument("--model", default="accurate", help="the bundle that judged (accurate)")
    return run_script(parser, _run, argv)


def _run(args: argparse.Namespace) -> None:
    table, bundle = PassageTable.load(args.folder / "passages"), load_bundle(args.model)
    settings = EvidenceSettings.from_mapping(bundle.evidence)
    kind = np.array([_KINDS[str(name)] for name in table.suite])
    stops_m = np.concatenate([_stops_m(table, k) for k in np.flatnonzero(kind == "pets stay")])
    people = np.flatnonzero((kind == "walk test") & np.isfinite(table.enters_s))
    if not stops_m.size or not people.size:
        raise UsageError(f"{args.folder}: too small a share of the test: no pet stops, or nobody")
    head = f"{len(people)} people missed | of those who begin where it stopped"
    say(f"| a pet that was known for sure stopped | {head} |")
    say("|---|---|---|")
    for gap_s in (math.inf, *GAPS_S):
        here = missed = near = 0.0
        for k in people:
            rows = _first_stay(table, k)
            reach = np.abs(stops_m - table.target_range_m[rows][0]) <= NEAR_M if len(rows) else 0.0
            chance = float(np.mean(reach))
            with_pet, without = (
                _is_missed(table, rows, settings, bundle.pet_limit, gap)
                for gap in (gap_s, math.inf)
            )
            missed += chance * with_pet + (1 - chance) * without
            here += chance * with_pet
            near += chance
        when = "never" if math.isinf(gap_s) else f"{gap_s:g} s before"
        there = f"{here / near:.1%}" if near else "-"
        say(f"| {when} | {missed:.1f}: {missed / len(people):.1%} | {there} |")


def _first_stay(table: PassageTable, k: int) -> NDArray[np.int64]:
    """Return the decisions of a passage's first stay with an open gate."""
    rows = np.arange(table.first[k], table.first[k + 1])
    is_open = table.is_open[rows]
    if not is_open.any():
        return rows[:0]
    begin = int(is_open.argmax())
    closed = np.flatnonzero(~is_open[begin:])
    return rows[begin : begin + int(closed[0])] if len(closed) else rows[begin:]


def _stops_m(table: PassageTable, k: int) -> NDArray[np.float64]:
    """Return where a passage's body was each time that the gate closed."""
    rows = slice(table.first[k], table.first[k + 1])
    is_open = table.is_open[rows]
    return table.target_range_m[rows][:-1][is_open[:-1] & ~is_open[1:]]


def _answers(
    table: PassageTable, rows: NDArray[np.int64], prior_human: float
) -> Iterator[tuple[float, Answer]]:
    for row in rows:
        quiet, most = table.fused_quiet[row], table.fused_most[row]
        if np.isfinite(quiet):
            p = np.array([(1 - quiet) * math.exp(-prior_human), most, quiet - most])
            yield table.t_s[row], Answer(_PET, np.log(np.maximum(p / p.sum(), 1e-300)), None)


def _is_missed(
    table: PassageTable,
    rows: NDArray[np.int64],
    settings: EvidenceSettings,
    pet_limit: float,
    gap_s: float,
) -> bool:
    evidence = Evidence(settings)
    verdict = Verdict(pet_limit, settings, _WITHIN_S)
    for k, (t_s, answer) in enumerate(_answers(table, rows, settings.prior_human)):
        if not k and math.isfinite(gap_s):
            sure = np.log([_PET.human, _PET.pet, _PET.other])
            evidence.fuse(Answer(_PET, sure, None), t_s=t_s - gap_s, range_m=0.0)
            evidence.end_visit()
        if verdict.judge(evidence.fuse(answer, t_s=t_s, range_m=0.0), t_s)[1]:
            return False
    return not verdict.leave()


if __name__ == "__main__":
    sys.exit(main())
