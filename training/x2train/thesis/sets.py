"""The data sets: shards of elements made once and kept, and put together cell by cell."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.dsp.downconvert import DownConverter
from radard.errors import UsageError
from radard.judge.features import extract
from radard.stream.ring import Dwell
from x2radar.frame import FastTimeAxis
from x2radar.recording.blocks import Label
from x2radar.recording.registry import open_recording
from x2train.sets.shards import ShardSet, fill
from x2train.sets.workers import Crew, Rows
from x2train.thesis.cells import Cell
from x2train.thesis.elements import PROFILE, ElementSpec, element

_SHARD = 250  # elements of a shard: a run that is stopped loses a minute or two
_LEVELS = 255  # maps are kept as bytes: a step is 0.12 dB


@dataclass(frozen=True, slots=True, eq=False)
class CellData:
    """Vectors and labels of one set, ready to train on."""

    x: NDArray[np.float32]  # (n, Q): feature vectors
    y: NDArray[np.int64]  # (n,): 0 for the animal (class 1), 1 for people (class 2), in turn
    in_view: NDArray[np.float32]  # (n,): share of the time in the swath

    def part(self, first: int, last: int) -> "CellData":
        """Return elements `first` to before `last`."""
        return CellData(self.x[first:last], self.y[first:last], self.in_view[first:last])


def make_bodies(
    folder: Path,
    spec: ElementSpec,
    body: str,
    first: int,
    n: int,
    *,
    crew: Crew,
) -> None:
    """Make the shards of one body's elements `first` to before `first + n`."""
    bounds = {_name(*ends): ends for ends in _bounds(first, n)}
    shards = _shards(folder, spec, body)
    fill(shards, bounds, partial(_row, spec, body), crew)


def load_cell(
    folder: Path, spec: ElementSpec, cell: Cell, first: int, n: int, *, rectified: bool = False
) -> CellData:
    """Return `n` elements of a set: animal and person in turn, `rectified` if asked."""
    x, in_view = _in_turn(folder, spec, cell, (first, n), ("vector", "in_view"))
    if cell.vector == 1:
        x = np.ascontiguousarray(x[:, PROFILE:])
    elif rectified:
        x = rectify(x)
    return CellData(x, np.tile(np.array([0, 1], np.int64), n // 2), in_view)


def load_maps(
    folder: Path, spec: ElementSpec, cell: Cell, first: int, n: int
) -> tuple[dict[str, NDArray[np.float32]], CellData]:
    """Return the maps of a data set, 'mu' and 'range_time', and the set (without vectors)."""
    keys = ("mu", "range_time", "in_view")
    mu, range_time, in_view = _in_turn(folder, spec, cell, (first, n), keys)
    maps = {
        name: (values / np.float32(_LEVELS)).astype(np.float32)
        for name, values in (("mu", mu), ("range_time", range_time))
    }
    y = np.tile(np.array([0, 1], np.int64), n // 2)
    return maps, CellData(np.empty((len(y), 0), np.float32), y, in_view)


def _in_turn(
    folder: Path, spec: ElementSpec, cell: Cell, which: tuple[int, int], keys: tuple[str, ...]
) -> list[NDArray[Any]]:
    first, n = which
    number = np.arange(n // 2)
    parts = [
        _load(_shards(folder, spec, body), first, n // 2, keys) for body in (*cell.bodies, "human")
    ]
    made = []
    for key in keys:
        animals = np.stack([part[key] for part in parts[:-1]])
        both = np.stack([animals[number % len(animals), number], parts[-1][key]], axis=1)
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


def _load(shards: ShardSet, first: int, n: int, keys: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    parts = [shards.read(_name(*ends)) for ends in _bounds(first, n)]
    return {key: np.concatenate([p[key] for p in parts]) for key in keys}


def _row(spec: ElementSpec, body: str, number: int) -> Rows:
    made = element(spec, body, number)
    return {
        "vector": made.vector[None],
        "mu": np.rint(made.mu[None] * _LEVELS).astype(np.uint8),
        "range_time": np.rint(made.range_time[None] * _LEVELS).astype(np.uint8),
        "in_view": np.array([made.in_view], np.float32),
    }


def _shards(folder: Path, spec: ElementSpec, body: str) -> ShardSet:
    about = asdict(spec)
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:8]
    name = f"{body}-{spec.frame_rate_hz}-{digest}"
    return ShardSet(folder / name, {"set": "thesis elements", "body": body, **about})


def _bounds(first: int, n: int) -> list[tuple[int, int]]:
    return [(at, min(at + _SHARD, first + n)) for at in range(first, first + n, _SHARD)]


def _name(first: int, last: int) -> str:
    return f"{first:07d}-{last:07d}"


LABELS = {"pet": 0, "dog": 0, "cat": 0, "human": 1, "person": 1}


def load_recordings(paths: Sequence[Path], spec: ElementSpec, vector: int) -> CellData:
    """Return the windows inside labels of recordings, hop one second, with a cell's vector.

    Labels are pet, dog, cat, human or person; others are left out. FILE=LABEL is a label of all of
    the file; otherwise those in it count. A recording may differ by 5 %
    in its rate from the spec's. Raises UsageError if one differs more, or none holds a labelled
    window of each class.
    """
    rows: list[NDArray[np.float32]] = []
    classes: list[int] = []
    for path in paths:
        name, _, whole = path.name.rpartition("=")
        is_named = bool(name) and whole in LABELS
        reader = open_recording(str(path.with_name(name) if is_named else path))
        rate_hz = reader.stream.frame_rate_hz
        if abs(rate_hz / spec.frame_rate_hz - 1) > 0.05:
            msg = f"{path}: {rate_hz:g} frames a second; these sets have {spec.frame_rate_hz}"
            raise UsageError(msg)
        labels = [label for label in reader.labels if label[2] in LABELS]
        if is_named:
            labels = [(0.0, reader.n_frames / rate_hz, whole)]
        if not labels:
            msg = f"{path}: no labels of {', '.join(LABELS)} in it; FILE=LABEL gives it one"
            raise UsageError(msg)
        samples = np.stack([frame.samples for frame in reader.frames()])
        for label in labels:
            for dwell in _windows(samples, reader.stream.axis, label, spec):
                rows.append(extract(dwell, spec.features, ("thesis_type2",))["thesis_type2"])
                classes.append(LABELS[label[2]])
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


def _windows(
    samples: NDArray[Any], axis: FastTimeAxis, label: Label, spec: ElementSpec
) -> Iterator[Dwell]:
    shape = spec.shape
    first = round(label[0] * spec.frame_rate_hz)
    last = min(round(label[1] * spec.frame_rate_hz), len(samples))
    converter = DownConverter(axis)
    for at in range(first, last - shape.n_slow + 1, spec.frame_rate_hz):
        frames = converter.convert(samples[at : at + shape.n_slow])
        valid = np.ones(shape.n_slow, np.bool_)
        yield Dwell(frames, valid, converter.axis, spec.frame_rate_hz, at / spec.frame_rate_hz)
