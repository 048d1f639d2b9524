"""The eight data sets: shards of elements made once and kept, and put together cell by cell."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from radard.dsp.downconvert import DownConverter
from radard.errors import UsageError
from radard.judge.features import extract
from radard.stream.ring import Dwell
from x2radar.recording.registry import open_recording
from x2train.sets.shards import ShardSet, fill
from x2train.sets.workers import Crew, Rows
from x2train.thesis.elements import PROFILE, ElementSpec, element

_SHARD = 250  # elements of a shard: a run that is stopped loses a minute or two
_LEVELS = 255  # maps are kept as bytes: a step is 0.12 dB
_MAPS = ("mu", "range_time")
RATES_HZ = (60, 200)  # the thesis'


@dataclass(frozen=True, slots=True)
class Cell:
    """One of the thesis' data sets: vector, animal and frame rate."""

    vector: int  # 1, or 2 for the range profile in front of type 1
    # class 1; people are class 2. 'pet', dogs and cats in turn, is not the thesis'
    animal: Literal["dog", "cat", "pet"]
    frame_rate_hz: int  # 60 or 200 in the thesis; any in this recipe

    @property
    def bodies(self) -> tuple[str, ...]:
        """What class 1 is drawn from."""
        return ("dog", "cat") if self.animal == "pet" else (self.animal,)

    @property
    def name(self) -> str:
        """Name of the set as the thesis writes it, such as T1D60."""
        return f"T{self.vector}{self.animal[0].upper()}{self.frame_rate_hz}"


CELLS = tuple(
    Cell(vector, animal, rate)
    for animal in ("dog", "cat")
    for vector in (1, 2)
    for rate in RATES_HZ
)
"""In the thesis' order (table 4.2)."""


@dataclass(frozen=True, slots=True, eq=False)
class CellData:
    """Vectors and labels of one set, ready to train on."""

    x: NDArray[np.float32]  # (n, Q): feature vectors
    y: NDArray[np.int64]  # (n,): 0 for the animal (class 1), 1 for people (class 2)
    in_view: NDArray[np.float32]  # (n,): share of the time in the swath

    @classmethod
    def in_turn(cls, x: NDArray[np.float32], in_view: NDArray[np.float32]) -> "CellData":
        """Return animal and person in turn."""
        return cls(x, np.tile(np.array([0, 1], np.int64), len(in_view) // 2), in_view)

    def part(self, first: int, last: int) -> "CellData":
        """Return elements `first` to before `last`."""
        return CellData(self.x[first:last], self.y[first:last], self.in_view[first:last])


def make_bodies(
    folder: Path, spec: ElementSpec, body: str, first: int, n: int, *, crew: Crew
) -> None:
    """Make the shards of one body's elements `first` to before `first + n`."""
    fill(_shards(folder, spec, body), _bounds(first, n), partial(_row, spec, body), crew)


def load_cell(
    folder: Path, spec: ElementSpec, cell: Cell, first: int, n: int, *, rectified: bool = False
) -> CellData:
    """Return `n` elements of a set: animal and person in turn, `rectified` if asked."""
    x, in_view = _in_turn(folder, spec, cell, first, n, "vector", "in_view")
    if cell.vector == 1:
        x = np.ascontiguousarray(x[:, PROFILE:])
    elif rectified:
        x = rectify(x)
    return CellData.in_turn(x, in_view)


def load_maps(
    folder: Path, spec: ElementSpec, cell: Cell, first: int, n: int
) -> tuple[dict[str, NDArray[np.float32]], CellData]:
    """Return the maps of a data set, 'mu' and 'range_time', and the set (without vectors)."""
    *maps, in_view = _in_turn(folder, spec, cell, first, n, *_MAPS, "in_view")
    scaled = (np.divide(each, _LEVELS, dtype=np.float32) for each in maps)
    made = dict(zip(_MAPS, scaled, strict=True))
    return made, CellData.in_turn(np.empty((n // 2 * 2, 0), np.float32), in_view)


def _in_turn(
    folder: Path, spec: ElementSpec, cell: Cell, first: int, n: int, *keys: str
) -> list[NDArray[Any]]:
    number = np.arange(n // 2)
    parts = []
    for body in (*cell.bodies, "human"):
        shards = _shards(folder, spec, body)
        parts.append([shards.read(name) for name in _bounds(first, n // 2)])
    made = []
    for key in keys:
        *bodies, people = (np.concatenate([row[key] for row in rows]) for rows in parts)
        animals = np.stack(bodies)
        both = np.stack([animals[number % len(animals), number], people], axis=1)
        made.append(both.reshape(-1, *both.shape[2:]))
    return made


def rectify(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return type 2 vectors whose strongest range sample lies in the first half of its extent."""
    out = x.copy()
    for row in out:
        profile = row[:PROFILE]
        filled = np.flatnonzero(profile)
        if filled.size and profile.argmax() > filled[-1] / 2:
            profile[: filled[-1] + 1] = profile[filled[-1] :: -1].copy()
    return out


def _row(spec: ElementSpec, body: str, number: int) -> Rows:
    made = element(spec, body, number)
    levels = {name: np.rint(made[name] * _LEVELS).astype(np.uint8) for name in _MAPS}
    return {name: values[None] for name, values in (made | levels).items()}


def _shards(folder: Path, spec: ElementSpec, body: str) -> ShardSet:
    about = asdict(spec)
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:8]
    name = f"{body}-{spec.frame_rate_hz}-{digest}"
    return ShardSet(folder / "data" / name, {"set": "thesis elements", "body": body, **about})


def _bounds(first: int, n: int) -> dict[str, tuple[int, int]]:
    starts = range(first, first + n, _SHARD)
    ends = ((at, min(at + _SHARD, first + n)) for at in starts)
    return {f"{at:07d}-{end:07d}": (at, end) for at, end in ends}


LABELS = {"pet": 0, "dog": 0, "cat": 0, "human": 1, "person": 1}


def load_recordings(paths: Sequence[Path], spec: ElementSpec, vector: int) -> CellData:
    """Return the windows inside labels of recordings, hop one second, with a cell's vector.

    Of labels that are not in `LABELS` nothing is taken. FILE=LABEL is a label of all of the file;
    otherwise those in it count. A recording may differ by 5 % in its rate from the spec's. Raises
    UsageError if one differs more, or none holds a labelled window of each class.
    """
    rows: list[NDArray[np.float32]] = []
    classes: list[int] = []
    for path in paths:
        name, _, whole = path.name.rpartition("=")
        is_named = bool(name) and whole in LABELS
        reader = open_recording(str(path.with_name(name) if is_named else path))
        rate_hz, own_hz = spec.frame_rate_hz, reader.stream.frame_rate_hz
        if abs(own_hz / rate_hz - 1) > 0.05:
            msg = f"{path}: {own_hz:g} frames a second; these sets have {rate_hz}"
            raise UsageError(msg)
        labels = [label for label in reader.labels if label[2] in LABELS]
        if is_named:
            labels = [(0.0, reader.n_frames / own_hz, whole)]
        if not labels:
            msg = f"{path}: no labels of {', '.join(LABELS)} in it; FILE=LABEL gives it one"
            raise UsageError(msg)
        samples = np.stack([frame.samples for frame in reader.frames()])
        converter, n_slow = DownConverter(reader.stream.axis), spec.shape.n_slow
        for begin_s, end_s, label in labels:
            first, last = (round(s * rate_hz) for s in (begin_s, end_s))
            last = min(last, len(samples)) - n_slow + 1
            for at in range(first, last, rate_hz):
                frames, valid = converter.convert(samples[at : at + n_slow]), np.ones(n_slow, bool)
                dwell = Dwell(frames, valid, converter.axis, rate_hz, at / rate_hz)
                rows.append(extract(dwell, spec.features, ("thesis_type2",))["thesis_type2"])
                classes.append(LABELS[label])
    if len(set(classes)) < 2:
        msg = "recordings: both classes are needed, pets and people, for two seconds each"
        raise UsageError(msg)
    # In turn as far as they go, so that any part of them holds both.
    y = np.array(classes, np.int64)
    rank = np.empty(len(y))
    for c in (0, 1):
        rank[y == c] = np.linspace(0, 1, int((y == c).sum()), endpoint=False)
    order = np.lexsort((y, rank))
    x = np.stack(rows)[order]
    x = x if vector == 2 else np.ascontiguousarray(x[:, PROFILE:])
    return CellData(x, y[order], np.ones(len(y), np.float32))
