"""Passages: what moved by, and everything the daemon decided while it did.

A passage is one body (or none) before one radar for some seconds. A table holds many in
columns, so that half a million decisions are a dozen arrays; on disk it is a set of shards
whose arrays are the columns, as `farm.make_shards` leaves them when every element returns
`JudgedPassage.columns()`.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from x2radar.errors import RecordingError
from x2train.sets.shards import MANIFEST, ShardSet

Label: TypeAlias = Literal["human", "pet", "other", "empty"]
LABELS: tuple[Label, ...] = get_args(Label)
_Column: TypeAlias = NDArray[Any]

TEXTS = ("family", "label", "split", "suite", "build")
NUMBERS = (
    "speed_mps",
    "range_m",
    "aspect_deg",
    "snr_db",
    "rcs_dbsm",
    "duration_s",
    "enters_s",
    "leaves_s",
)
FLAGS = ("is_open", "is_pending", "is_alarm")
SERIES = (
    "t_s",
    "p_human",
    "p_pet",
    "p_other",
    "fused_quiet",
    "fused_most",
    "power_db",
    "target_range_m",
    "compensated_db",
)
"""Columns: of passages (text, float64), of decisions (bool, float64)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JudgedPassage:
    """One passage and its decisions."""

    family: str  # what moved: 'walker', 'dog, large', 'crawler', 'fan', ...
    label: Label  # the truth; a person with a pet is human
    split: str = ""  # 'train families', 'held-out family', 'unseen room', ...
    suite: str = ""  # a named test ('walk test: across 1.0 m/s'), or empty
    build: str = ""  # of the body, its height, mass and limbs
    # means over the time in the swath; NaN where there is no such thing
    speed_mps: float = np.nan
    range_m: float = np.nan
    aspect_deg: float = np.nan
    snr_db: float = np.nan
    rcs_dbsm: float = np.nan
    duration_s: float  # of the passage
    # first and last stream second in which the body was in the swath; NaN when never
    enters_s: float = np.nan
    leaves_s: float = np.nan
    # (n,): stream time at the end of every dwell that was decided on, ascending
    t_s: NDArray[np.float64]
    # (n,): gate open; label `pending`; the daemon's verdict
    is_open: NDArray[np.bool_]
    is_pending: NDArray[np.bool_]
    is_alarm: NDArray[np.bool_]
    # (n,): calibrated probabilities of each window; NaN with the gate closed
    p_human: NDArray[np.float64]
    p_pet: NDArray[np.float64]
    p_other: NDArray[np.float64]
    # (n,): fused p_pet + p_other. Not as one minus p_human: 1e-12 and 1e-6 must differ. NaN with
    # the gate closed.
    fused_quiet: NDArray[np.float64]
    fused_most: NDArray[np.float64]  # (n,): the larger of the two in it; NaN with the gate closed
    power_db: NDArray[np.float64]  # (n,): total residual power
    target_range_m: NDArray[np.float64]  # (n,): where it is; NaN with the gate closed
    # (n,): residual power times range to the fourth: what the radar cross-section would be
    compensated_db: NDArray[np.float64]

    def columns(self) -> dict[str, _Column]:
        """Return the passage as one row of the passages' columns and n of the decisions'.

        Raises UsageError if the label is none of the four, or the arrays differ in length.
        """
        if self.label not in LABELS:
            msg = f"label {self.label!r}: must be one of {', '.join(LABELS)}"
            raise UsageError(msg)
        columns: dict[str, _Column] = {"n_decisions": np.array([len(self.t_s)], np.int64)}
        columns |= {name: np.array([getattr(self, name)], np.str_) for name in TEXTS}
        columns |= {name: np.array([getattr(self, name)], np.float64) for name in NUMBERS}
        columns |= {name: np.asarray(getattr(self, name), np.bool_) for name in FLAGS}
        columns |= {name: np.asarray(getattr(self, name), np.float64) for name in SERIES}
        for name in (*FLAGS, *SERIES):
            if columns[name].shape != (len(self.t_s),):
                msg = f"{name}: shape {columns[name].shape}, not ({len(self.t_s)},) like t_s"
                raise UsageError(msg)
        return columns


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PassageTable:
    """Many passages in columns; see `JudgedPassage` for their meaning."""

    # (n_passages,): how many rows of the decisions' columns belong to each passage, in order
    n_decisions: NDArray[np.int64]
    family: NDArray[np.str_]
    label: NDArray[np.str_]
    split: NDArray[np.str_]
    suite: NDArray[np.str_]
    build: NDArray[np.str_]
    speed_mps: NDArray[np.float64]
    range_m: NDArray[np.float64]
    aspect_deg: NDArray[np.float64]
    snr_db: NDArray[np.float64]
    rcs_dbsm: NDArray[np.float64]
    duration_s: NDArray[np.float64]
    enters_s: NDArray[np.float64]
    leaves_s: NDArray[np.float64]
    t_s: NDArray[np.float64]
    is_open: NDArray[np.bool_]
    is_pending: NDArray[np.bool_]
    is_alarm: NDArray[np.bool_]
    p_human: NDArray[np.float64]
    p_pet: NDArray[np.float64]
    p_other: NDArray[np.float64]
    fused_quiet: NDArray[np.float64]
    fused_most: NDArray[np.float64]
    power_db: NDArray[np.float64]
    target_range_m: NDArray[np.float64]
    compensated_db: NDArray[np.float64]
    # (n_passages + 1,): row of the decisions' columns at which each passage begins
    first: NDArray[np.int64] = field(init=False)
    # (n_decisions,): passage of every decision
    passage: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        n = len(self.n_decisions)
        ends = np.concatenate([[0], np.cumsum(self.n_decisions)]).astype(np.int64)
        object.__setattr__(self, "first", ends)
        object.__setattr__(self, "passage", np.repeat(np.arange(n), self.n_decisions))
        lengths = dict.fromkeys((*TEXTS, *NUMBERS), n)
        lengths |= dict.fromkeys((*FLAGS, *SERIES), int(ends[-1]))
        for name, length in lengths.items():
            if getattr(self, name).shape != (length,):
                msg = f"{name}: shape {getattr(self, name).shape}, not ({length},)"
                raise UsageError(msg)

    def __len__(self) -> int:
        return len(self.n_decisions)

    def __getitem__(self, index: int) -> JudgedPassage:
        facts = {name: getattr(self, name)[index].item() for name in (*TEXTS, *NUMBERS)}
        rows = slice(self.first[index], self.first[index + 1])
        return JudgedPassage(**facts, **{n: getattr(self, n)[rows] for n in (*FLAGS, *SERIES)})

    @classmethod
    def of(cls, passages: Iterable[JudgedPassage]) -> "PassageTable":
        """Return a table of passages, in order; an empty one of none."""
        return cls.joined([passage.columns() for passage in passages])

    @classmethod
    def joined(cls, parts: Iterable[Mapping[str, _Column]]) -> "PassageTable":
        """Return a table of sets of columns, one below the other; UsageError if one is missing."""
        parts = [_empty(), *(part for part in parts if part)]
        try:
            columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        except KeyError as err:
            msg = f"passages without the column {err.args[0]!r}"
            raise UsageError(msg) from None
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
        """Read a set of shards of passages.

        Raises RecordingError if there is none or a shard is damaged, UsageError if it is of
        something else.
        """
        shards = ShardSet(folder, _about(folder))
        return cls.joined(shards.read(name) for name in shards.names())


def _empty() -> dict[str, _Column]:
    columns: dict[str, _Column] = {"n_decisions": np.empty(0, np.int64)}
    columns |= {name: np.empty(0, "U1") for name in TEXTS}
    columns |= {name: np.empty(0, np.float64) for name in (*NUMBERS, *SERIES)}
    return columns | {name: np.empty(0, np.bool_) for name in FLAGS}


def _about(folder: Path) -> dict[str, Any]:
    try:
        return dict(json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["about"])
    except (OSError, ValueError, KeyError, TypeError) as err:
        msg = f"{folder}: no set of passages ({err})"
        raise RecordingError(msg) from err
