"""Groups: the same figures by family, suite, split, and how the body moved and was seen."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2train.judge.estimates import Estimate, per_hour
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import Outcome, Verdicts, hours, outcome

_EDGES = {
    "speed_mps": (0.0, 0.1, 0.3, 0.6, 1.0, 1.5, 2.2, 3.0),
    "range_m": (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0),
    "aspect_deg": (0.0, 30.0, 60.0, 90.0, 120.0, 150.0),
    "snr_db": (0.0, 6.0, 12.0, 18.0, 24.0, 30.0, 36.0),
}
"""Lower ends of the bins; what is below the first has a bin of its own."""
_MAX_BUILDS = 40  # a longer table is not read
_Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Group:
    """Passages that have something in common."""

    name: str  # what: a family, or '0.3 to 0.6'
    # at the limit the daemon ships with, and at the one for the false-alarm budget
    shipped: Outcome
    at_budget: Outcome
    quiet_hours: float  # how long other motion, or nothing, was there
    n_quiet_alarms: int  # minutes of that with an alarm, as shipped
    quiet_alarms_per_hour: Estimate  # per hour of it


def group(
    table: PassageTable,
    name: str,
    chosen: _Bool,
    found: tuple[Verdicts, Verdicts],
    rng: np.random.Generator,
) -> Group:
    """Return the figures of the chosen passages; `found`: as shipped, and at the budget."""
    quiet = chosen & ((table.label == "other") | (table.label == "empty"))
    quiet_hours = hours(table, quiet)
    n_quiet = int(found[0].false_alarms[quiet].sum())
    return Group(
        name,
        outcome(table, found[0], chosen, rng),
        outcome(table, found[1], chosen, rng),
        quiet_hours,
        n_quiet,
        per_hour(n_quiet, quiet_hours),
    )


def groups(
    table: PassageTable, found: tuple[Verdicts, Verdicts], rng: np.random.Generator
) -> dict[str, tuple[Group, ...]]:
    """Return the figures by everything that is known of the passages: people first."""
    by = {key: _named(getattr(table, key)) for key in ("split", "family", "suite")}
    if len(np.unique(table.build)) <= _MAX_BUILDS:
        by["build"] = _named(table.build)
    by |= {key: _binned(getattr(table, key), edges) for key, edges in _EDGES.items()}
    made = {
        key: [group(table, name, chosen, found, rng) for name, chosen in parts]
        for key, parts in by.items()
    }
    for key in made.keys() - _EDGES.keys():
        made[key].sort(key=lambda g: (g.shipped.n_intrusions == 0, g.shipped.pet_hours == 0))
    return {key: tuple(parts) for key, parts in made.items()}


def _named(values: NDArray[np.str_]) -> Iterator[tuple[str, _Bool]]:
    for name in np.unique(values):
        if name:
            yield str(name), values == name


def _binned(values: NDArray[np.float64], edges: tuple[float, ...]) -> Iterator[tuple[str, _Bool]]:
    # NaN is in no bin: comparing it is false.
    lows, highs = (-np.inf, *edges), (*edges, np.inf)
    for low, high in zip(lows, highs, strict=True):
        chosen = (values >= low) & (values < high)
        if chosen.any():
            if np.isinf(low):
                name = f"below {high:g}"
            elif np.isinf(high):
                name = f"{low:g} and more"
            else:
                name = f"{low:g} to {high:g}"
            yield name, chosen
