"""Shards: arrays on disk that a later run may trust, and that an interrupted one leaves whole.

A set is a folder with a manifest (JSON: what the set is, and per shard its name, rows and SHA-256)
and shards (.npz), each written beside, synced, renamed, and only then entered. Element k is drawn
from a generator seeded with k, in one process or a hundred; the parent alone joins them, in order,
so a run that was interrupted goes on after its last whole shard. Linear algebra has one thread,
because it may round differently with another number.
"""

import hashlib
import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from radard.config.json_file import STRICT, parse_json
from radard.errors import UsageError
from x2radar.atomic import write_whole
from x2radar.errors import RecordingError
from x2train.sets.workers import ALONE, CHUNK, Crew, Make, Rows, workers_for

Arrays = Mapping[str, NDArray[Any]]
MANIFEST = "manifest.json"
VERSION = 1


class ShardSet:
    """One set of shards in a folder, made `about` the same; UsageError or RecordingError."""

    def __init__(self, folder: Path, about: Mapping[str, Any]) -> None:
        self.folder = folder
        self.about = json.loads(json.dumps(dict(about)))
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as err:
            raise RecordingError(f"{folder}: cannot make this folder: {err.strerror}") from err
        self._shards: dict[str, dict[str, Any]] = {}
        if (folder / MANIFEST).exists():
            known = read_manifest(folder)
            keys = sorted({*known.about, *self.about})
            rows = ((key, known.about.get(key), self.about.get(key)) for key in keys)
            changed = [f"{key}: {old!r}, not {new!r}" for key, old, new in rows if old != new]
            if changed:
                said = ", ".join(changed[:3])
                msg = f"{folder}: holds a set that was made otherwise ({said}); remove it"
                raise UsageError(msg)
            self._shards = known.shards

    def __contains__(self, name: str) -> bool:
        """Return whether a shard is complete."""
        return name in self._shards and (self.folder / f"{name}.npz").exists()

    def write(self, name: str, arrays: Arrays) -> None:
        """Add or replace a shard; RecordingError, and the set as it was, if the disk refuses."""
        memory = io.BytesIO()
        arrays_by_name: dict[str, Any] = dict(arrays)
        np.savez(memory, **arrays_by_name)
        data = memory.getvalue()
        write_whole(self.folder / f"{name}.npz", data)
        rows = len(next(iter(arrays.values()), ()))
        self._shards[name] = {"rows": rows, "sha256": hashlib.sha256(data).hexdigest()}
        manifest = {"version": VERSION, "about": self.about, "shards": self._shards}
        text = json.dumps(manifest, indent=1, sort_keys=True)
        write_whole(self.folder / MANIFEST, text.encode())

    def read(self, name: str) -> dict[str, NDArray[Any]]:
        """Return a shard's arrays; RecordingError if it is missing or its checksum is wrong."""
        path = self.folder / f"{name}.npz"
        try:
            data = path.read_bytes()
        except OSError as err:
            raise RecordingError(f"{path}: cannot read: {err.strerror}") from err
        if hashlib.sha256(data).hexdigest() != self._shards.get(name, {}).get("sha256"):
            msg = f"{path}: its checksum is not that of {MANIFEST}; remove it to make it again"
            raise RecordingError(msg)
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return {key: arrays[key] for key in arrays.files}

    def names(self) -> Iterator[str]:
        """Yield the names of the complete shards, in order."""
        yield from sorted(name for name in self._shards if name in self)


@dataclass(frozen=True, slots=True)
class Manifest:
    """What a set is made from, and its shards."""

    __pydantic_config__ = STRICT

    version: Literal[1]
    about: dict[str, Any]
    shards: dict[str, dict[str, Any]]


def read_manifest(folder: Path) -> Manifest:
    """Return what a set is made from, and its shards; RecordingError if there is none."""
    path = folder / MANIFEST
    try:
        return parse_json(Manifest, path.read_bytes())
    except FileNotFoundError as err:
        raise RecordingError(f"{folder}: no set of shards here ({MANIFEST} is missing)") from err
    except (OSError, ValueError) as err:
        raise RecordingError(f"{path}: no manifest of shards ({err}); remove the folder") from err


def read_all(folder: Path) -> tuple[Mapping[str, Any], dict[str, NDArray[Any]]]:
    """Return what a set was made from, and the columns of all its shards; or RecordingError."""
    known = read_manifest(folder)
    shards = ShardSet(folder, known.about)
    # A shard of elements that were all left out has no columns.
    parts = [part for name in sorted(known.shards) if (part := shards.read(name))]
    keys = list(parts[0]) if parts else []
    # Popped: sets take gigabytes, and no column stays twice.
    return known.about, {key: np.concatenate([p.pop(key) for p in parts]) for key in keys}


def make_shards(
    folder: Path,
    about: Mapping[str, Any],
    n_elements: int,
    make: Make,
    crew: Crew = ALONE,
    *,
    per_shard: int = 1000,
) -> ShardSet:
    """Make a set of shards, or what is missing of it, of elements 0 to n_elements - 1.

    `about` is what they are drawn from. `make` takes an element's number and returns its arrays,
    of any lengths, with the same names and dtypes for every element, or None to leave it out; it
    must be importable by name in a new process. Raises UsageError if the folder holds a set that
    was made otherwise, RecordingError if the disk does not take a shard, and RadardError if `make`
    fails (whole shards are kept), the cluster cannot be reached or a worker died.
    """
    shards = ShardSet(folder, {**about, "elements": n_elements, "per_shard": per_shard})
    bounds = {
        f"shard-{k:05d}": (first, min(first + per_shard, n_elements))
        for k, first in enumerate(range(0, n_elements, per_shard))
    }
    fill(shards, bounds, make, crew)
    return shards


def fill(shards: ShardSet, bounds: Mapping[str, tuple[int, int]], make: Make, crew: Crew) -> None:
    """Make the missing shards of a set; `bounds` are first element and end, by name."""
    missing = {name: ends for name, ends in bounds.items() if name not in shards}
    total = sum(last - first for first, last in bounds.values())
    done = total - sum(last - first for first, last in missing.values())
    crew.report(done, total)
    chunks = [
        range(k, min(k + CHUNK, last))
        for first, last in missing.values()
        for k in range(first, last, CHUNK)
    ]
    if not chunks:
        return
    with workers_for(crew, len(chunks)) as run:
        made = zip(chunks, run(make, chunks), strict=True)
        for name, (first, last) in missing.items():
            rows: list[Rows] = []
            for _ in range(first, last, CHUNK):
                chunk, part = next(made)
                rows += part
                done += len(chunk)
                crew.report(done, total)
            names = list(rows[0]) if rows else []
            shards.write(name, {key: np.concatenate([row[key] for row in rows]) for key in names})
