"""Farm: make the elements of a data set, in one process or a hundred, always the same.

Element k is made by `make(k)`, which draws from a generator seeded with k. Elements are
handed out in small chunks; the parent alone joins them, in order, and writes shards. So
the bytes on disk depend on neither the number of workers nor their luck, a worker needs no
disk of the set's, and a run that was interrupted goes on after its last whole shard.

Linear algebra may round differently with another number of threads: wherever elements are
made, it has one.
"""

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from radard.errors import RadardError, UsageError
from x2train.generate.shards import ShardSet
from x2train.generate.workers import (
    CHUNK,
    Chunk,
    Crew,
    Made,
    Make,
    Rows,
    in_process,
    is_pinned,
    on_cluster,
    pool,
)


class ElementError(RadardError):
    """An element could not be made; the message names it."""


@dataclass(frozen=True, slots=True)
class ShardProgress:
    """How far a run is."""

    done: int
    total: int
    per_s: float
    left_s: float


def make_shards(
    folder: Path,
    about: Mapping[str, Any],
    n_elements: int,
    make: Make,
    *,
    per_shard: int = 1000,
    workers: int = 1,
    cluster: str | None = None,
    report: Callable[[ShardProgress], None] | None = None,
) -> ShardSet:
    """Make a set of shards, or what is missing of it.

    Parameters
    ----------
    folder : Path
        Of the set.
    about : mapping
        What the elements are drawn from; the set is refused if it was made otherwise.
    n_elements : int
        Elements 0 to n_elements - 1.
    make : callable
        Element number to its arrays, of any lengths, with the same names and dtypes for
        every element; None leaves it out. It must be importable by name in a new process.
    per_shard : int
        Elements per shard.
    workers : int
        Local processes.
    cluster : str, optional
        Address of a Dask scheduler, whose workers are used instead; they must have this
        package, and what `make` needs, installed.
    report : callable, optional
        Told the progress after every chunk.

    Returns
    -------
    ShardSet
        Shards 'shard-00000', ...: for each name the elements' arrays one after another.

    Raises
    ------
    UsageError
        If a number is out of range, or the folder holds another set.
    ElementError
        If `make` fails; shards that were whole by then are kept.
    GenerateError
        If the cluster cannot be reached, or a worker died.
    RecordingError
        If the disk does not take a shard.
    """
    for name, value in (
        ("n_elements", n_elements),
        ("per_shard", per_shard),
        ("workers", workers),
    ):
        if value < 1:
            msg = f"{name} {value}: must be at least 1"
            raise UsageError(msg)
    shards = ShardSet(folder, {**about, "elements": n_elements, "per_shard": per_shard})
    bounds = {
        f"shard-{k:05d}": (first, min(first + per_shard, n_elements))
        for k, first in enumerate(range(0, n_elements, per_shard))
    }
    missing = {name: ends for name, ends in bounds.items() if name not in shards}
    chunks = [
        Chunk(k, min(k + CHUNK, last))
        for first, last in missing.values()
        for k in range(first, last, CHUNK)
    ]
    if not chunks:
        return shards
    clock = _Clock(n_elements, sum(c.last - c.first for c in chunks), report)
    with _pool(min(workers, len(chunks)), cluster) as run:
        made = run(make, chunks)
        for name, (first, last) in missing.items():
            shards.write(name, _joined(_shard_rows(made, first, last, clock)))
    return shards


def _pool(workers: int, cluster: str | None) -> Crew:
    if cluster is not None:
        return on_cluster(cluster)
    return in_process() if workers == 1 and is_pinned() else pool(workers)


def _shard_rows(made: Iterator[Made], first: int, last: int, clock: "_Clock") -> list[Rows]:
    rows: list[Rows] = []
    for start in range(first, last, CHUNK):
        part = next(made)
        if part.error:
            raise ElementError(part.error)
        rows += part.rows
        clock.count(min(CHUNK, last - start))
    return rows


def _joined(rows: list[Rows]) -> dict[str, NDArray[Any]]:
    names = list(rows[0]) if rows else []
    return {name: np.concatenate([row[name] for row in rows]) for name in names}


@dataclass(slots=True)
class _Clock:
    """Counts elements, and tells."""

    total: int
    missing: int
    report: Callable[[ShardProgress], None] | None
    made: int = 0
    began_s: float = field(default_factory=time.monotonic)

    def count(self, n: int) -> None:
        self.made += n
        if self.report is not None:
            per_s = self.made / max(time.monotonic() - self.began_s, 1e-9)
            left = self.missing - self.made
            self.report(ShardProgress(self.total - left, self.total, per_s, left / per_s))


class ProgressLine:
    """Writes progress: one line that is rewritten on a terminal, else a line now and then.

    Parameters
    ----------
    text : str
        What is being made.
    stream : file
        Where to; stderr unless given.
    every_s : float
        Least time between lines where they are not rewritten, in seconds.
    """

    def __init__(self, text: str, stream: TextIO | None = None, every_s: float = 30.0) -> None:
        self._text = text
        self._stream = sys.stderr if stream is None else stream
        self._is_rewritten = self._stream.isatty()
        self._every_s = 0.2 if self._is_rewritten else every_s
        self._next_s = -1.0

    def __call__(self, now: ShardProgress) -> None:
        """Write, unless it was done a moment ago; the last one always."""
        is_last = now.done == now.total
        if time.monotonic() < self._next_s and not is_last:
            return
        self._next_s = time.monotonic() + self._every_s
        line = (
            f"{self._text}: {now.done:,} of {now.total:,} ({now.done / now.total:.0%}), "
            f"{now.per_s:.3g}/s, {_duration(now.left_s)} left"
        )
        if self._is_rewritten:
            self._stream.write(f"\r{line}\x1b[K" + ("\n" if is_last else ""))
        else:
            self._stream.write(line + "\n")
        self._stream.flush()


def _duration(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
