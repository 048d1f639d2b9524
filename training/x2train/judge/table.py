"""Passages, one body (or none) before one radar, and all that was decided, in columns."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from x2train.sets.shards import ShardSet, read_all

LABELS = ("human", "pet", "other", "empty")
Columns: TypeAlias = dict[str, NDArray[Any]]

TEXTS = ("family", "label", "split", "suite", "build")
NUMBERS = (
    *("speed_mps", "range_m", "aspect_deg", "snr_db"),
    *("duration_s", "enters_s", "leaves_s"),
)
FLAGS = ("is_open", "is_pending", "is_alarm")
SERIES = (
    *("t_s", "p_human", "p_pet", "p_other", "fused_quiet", "fused_most"),
    *("power_db", "target_range_m", "compensated_db"),
)
"""Columns: of passages (text, float64), of decisions (bool, float64)."""


def passage_columns(**facts: Any) -> Columns:
    """Return one passage as a row of the passages' columns and n of the decisions', by name."""
    columns: Columns = {"n_decisions": np.array([len(facts["t_s"])], np.int64)}
    columns |= {name: np.array([facts.get(name, "")], np.str_) for name in TEXTS}
    columns |= {name: np.array([facts.get(name, np.nan)], np.float64) for name in NUMBERS}
    columns |= {name: np.asarray(facts[name], np.bool_) for name in FLAGS}
    columns |= {name: np.asarray(facts[name], np.float64) for name in SERIES}
    return columns


_ONE = passage_columns(**dict.fromkeys((*FLAGS, *SERIES), ()))
_NONE = {name: column[:0] for name, column in _ONE.items()}
"""Columns of no passage, which have their types as well."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PassageTable:
    """Passages, columns of shape (n_passages,), and their decisions, (n_decisions,)."""

    n_decisions: NDArray[np.int64]  # how many rows of the decisions' columns each passage has
    family: NDArray[np.str_]  # what moved: 'walker', 'dog, large', 'crawler', 'fan', ...
    label: NDArray[np.str_]  # the truth, of `LABELS`; a person with a pet is human
    split: NDArray[np.str_]  # 'train families', 'held-out family', 'unseen room', ...
    suite: NDArray[np.str_]  # a named test ('walk test: across 1.0 m/s'), or empty
    build: NDArray[np.str_]  # of the body, its height, mass and limbs
    # means over the time in the swath; NaN where there is no such thing
    speed_mps: NDArray[np.float64]
    range_m: NDArray[np.float64]
    aspect_deg: NDArray[np.float64]
    snr_db: NDArray[np.float64]
    duration_s: NDArray[np.float64]  # of the passage
    # first and last stream second in which the body was in the swath; NaN when never
    enters_s: NDArray[np.float64]
    leaves_s: NDArray[np.float64]
    t_s: NDArray[np.float64]  # stream time at the end of every dwell, ascending
    # gate open; label `pending`; the daemon's verdict
    is_open: NDArray[np.bool_]
    is_pending: NDArray[np.bool_]
    is_alarm: NDArray[np.bool_]
    # calibrated probabilities of each window; NaN with the gate closed
    p_human: NDArray[np.float64]
    p_pet: NDArray[np.float64]
    p_other: NDArray[np.float64]
    # fused p_pet + p_other, not as one minus p_human: 1e-12 and 1e-6 must differ; the larger of
    # the two in it; NaN with the gate closed
    fused_quiet: NDArray[np.float64]
    fused_most: NDArray[np.float64]
    power_db: NDArray[np.float64]  # total residual power
    target_range_m: NDArray[np.float64]  # where it is; NaN with the gate closed
    # residual power times range to the fourth: what the radar cross-section would be
    compensated_db: NDArray[np.float64]
    # (n_passages + 1,): row of the decisions' columns at which each passage begins
    first: NDArray[np.int64] = field(init=False)
    # (n_decisions,): passage of every decision
    passage: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        ends = np.concatenate([[0], np.cumsum(self.n_decisions)]).astype(np.int64)
        object.__setattr__(self, "first", ends)
        object.__setattr__(self, "passage", np.repeat(np.arange(len(self)), self.n_decisions))

    def __len__(self) -> int:
        return len(self.n_decisions)

    @classmethod
    def of(cls, parts: Iterable[Mapping[str, NDArray[Any]]]) -> "PassageTable":
        """Return a table of columns, one below the other; UsageError if one is missing."""
        parts = [_NONE, *(part for part in parts if part)]
        try:
            columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        except KeyError as err:
            raise UsageError(f"passages without the column {err.args[0]!r}") from None
        return cls(**columns)

    def chosen(self, keep: NDArray[np.bool_]) -> "PassageTable":
        """Return the passages for which `keep`, shape (n_passages,), is true."""
        rows = keep[self.passage]
        columns = {name: getattr(self, name)[keep] for name in ("n_decisions", *TEXTS, *NUMBERS)}
        columns |= {name: getattr(self, name)[rows] for name in (*FLAGS, *SERIES)}
        return PassageTable(**columns)

    def save(self, folder: Path, about: Mapping[str, Any]) -> None:
        """Write the table as a set of one shard; `about` says what it was made from."""
        names = [f.name for f in fields(self) if f.init]
        ShardSet(folder, about).write("shard-00000", {name: getattr(self, name) for name in names})

    @classmethod
    def load(cls, folder: Path) -> "PassageTable":
        """Read a set of shards of passages; RecordingError or UsageError if it is none."""
        return cls.of([read_all(folder)[1]])
