"""Make the elements of a data set, in one process or a hundred, always the same.

Element k is drawn from a generator seeded with k; the parent alone joins them, in order, and
writes shards, so a run that was interrupted goes on after its last whole shard. Linear algebra has
one thread, because it may round differently with another number.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from x2train.sets.shards import ShardSet
from x2train.sets.workers import ALONE, CHUNK, Crew, Make, Rows, workers_for


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

    Parameters
    ----------
    folder, about : Path and mapping
        The set, and what its elements are drawn from; it is refused if it was made otherwise.
    make : callable
        Element number to its arrays, of any lengths, with the same names and dtypes for every
        element; None leaves it out. It must be importable by name in a new process.
    crew, per_shard : Crew and int
        Who makes them; elements per shard.

    Raises
    ------
    UsageError, ElementError, GenerateError, RecordingError
        If the folder holds another set; `make` fails (whole shards are kept); the cluster cannot
        be reached or a worker died; the disk does not take a shard.
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
