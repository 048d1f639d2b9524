"""Compare: two models on the same passages, passage by passage."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from x2train.judge.estimates import Estimate, resampled
from x2train.judge.figures import Figures
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import intrusions

_Bool = NDArray[np.bool_]
_Float = NDArray[np.float64]
_SAME = ("label", "family", "duration_s", "enters_s", "leaves_s")


@dataclass(frozen=True, slots=True)
class Overlap:
    """Passages that went wrong."""

    both: int
    here: int
    there: int


@dataclass(frozen=True, slots=True)
class Pairing:
    """Who got wrong what the other did not."""

    name: str  # the operating point of both
    # intrusions without an alarm, and passages of pets with one
    missed: Overlap
    alarmed: Overlap
    # miss rate less that of the other; the interval is of passages drawn again in pairs
    miss_rate_less_other: Estimate


def check_same(table: PassageTable, other: PassageTable) -> None:
    """Raise UsageError unless both are of the same passages in the same order."""
    if len(table) != len(other):
        msg = f"the other model saw {len(other)} passages, not {len(table)}"
        raise UsageError(msg)
    for name in _SAME:
        here, there = getattr(table, name), getattr(other, name)
        same = here == there if here.dtype.kind == "U" else (here == there) | np.isnan(here)
        if not same.all():
            k = int(np.argmin(same))
            msg = f"the other model saw other passages: {name} of {k} is {there[k]}, not {here[k]}"
            raise UsageError(msg)


def pairings(
    table: PassageTable, here: Figures, there: Figures, seed: int
) -> tuple[Pairing, Pairing]:
    """Return the comparison as shipped, and each at its limit for the false-alarm budget."""
    rng = np.random.default_rng(seed)
    people, pets = intrusions(table), table.label == "pet"
    made = []
    for k, name in enumerate(("as shipped", "each at one false alarm in 60 pet-hours")):
        missed = [~f.found[k].is_alarm[people] for f in (here, there)]
        false = [f.found[k].false_alarms[pets] > 0 for f in (here, there)]
        difference = missed[0].astype(float) - missed[1]

        def mean(weight: _Float, d: _Float = difference) -> float:
            return float(weight @ d / weight.sum()) if len(d) else float("nan")

        difference_of = resampled(mean, int(people.sum()), rng)
        made.append(Pairing(name, _overlap(*missed), _overlap(*false), difference_of))
    return made[0], made[1]


def _overlap(here: _Bool, there: _Bool) -> Overlap:
    both, only_here, only_there = here & there, here & ~there, ~here & there
    return Overlap(int(both.sum()), int(only_here.sum()), int(only_there.sum()))
