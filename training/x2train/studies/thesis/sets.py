"""The data sets: shards of elements made once and kept, and put together cell by cell."""

import hashlib
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2train.generate.shards import ShardSet
from x2train.studies.thesis.cells import Cell
from x2train.studies.thesis.elements import PROFILE, ElementSpec, element

_CHUNK = 250
_LEVELS = 255
"""Maps are kept as bytes: a step is 0.12 dB."""


@dataclass(frozen=True, slots=True, eq=False)
class CellData:
    """One data set.

    Attributes
    ----------
    x : ndarray, shape (n, Q), float32
        Feature vectors.
    y : ndarray, shape (n,), int64
        0 for the animal (class 1), 1 for people (class 2), in turn.
    in_view : ndarray, shape (n,), float32
        Share of the time in the swath.
    """

    x: NDArray[np.float32]
    y: NDArray[np.int64]
    in_view: NDArray[np.float32]

    def part(self, first: int, last: int) -> "CellData":
        """Return elements `first` to before `last`."""
        return CellData(self.x[first:last], self.y[first:last], self.in_view[first:last])


def make_bodies(
    folder: Path, spec: ElementSpec, body: str, first: int, n: int, *, workers: int = 1
) -> Iterator[int]:
    """Make the shards of one body's elements; yield how many are there.

    Parameters
    ----------
    folder : Path
        Of the cache.
    spec : ElementSpec
        What to draw from.
    body : str
        Which body.
    first, n : int
        Numbers of the elements.
    workers : int
        Processes; the shards do not depend on it.

    Yields
    ------
    int
        Elements done.
    """
    shards = _shards(folder, spec, body)
    jobs = []
    done = 0
    for at in range(first, first + n, _CHUNK):
        last = min(at + _CHUNK, first + n)
        if _name(at, last) in shards:
            done += last - at
        else:
            jobs.append((spec, body, at, last))
    yield done
    if workers == 1 or len(jobs) < 2:
        results: Iterator[dict[str, NDArray[Any]]] = map(_chunk, jobs)
        for job, arrays in zip(jobs, results, strict=True):
            shards.write(_name(job[2], job[3]), arrays)
            done += job[3] - job[2]
            yield done
        return
    with ProcessPoolExecutor(workers) as pool:
        for job, arrays in zip(jobs, pool.map(_chunk, jobs), strict=True):
            shards.write(_name(job[2], job[3]), arrays)
            done += job[3] - job[2]
            yield done


def load_cell(
    folder: Path, spec: ElementSpec, cell: Cell, first: int, n: int, *, rectified: bool = False
) -> CellData:
    """Return a data set whose shards were made: animal and person in turn.

    Parameters
    ----------
    folder, spec, first : as in `make_bodies`
    cell : Cell
        Which vector and animal; its frame rate is the spec's.
    n : int
        Elements, half of each class.
    rectified : bool
        Turn range profiles so that the strongest sample lies left of the centre.
    """
    x, in_view = _in_turn(_pair(folder, spec, cell), first, n, ("vector", "in_view"))
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
    mu, range_time, in_view = _in_turn(_pair(folder, spec, cell), first, n, keys)
    maps = {
        name: (values / np.float32(_LEVELS)).astype(np.float32)
        for name, values in (("mu", mu), ("range_time", range_time))
    }
    y = np.tile(np.array([0, 1], np.int64), n // 2)
    return maps, CellData(np.empty((len(y), 0), np.float32), y, in_view)


def _in_turn(
    pair: tuple[ShardSet, ShardSet], first: int, n: int, keys: tuple[str, ...]
) -> list[NDArray[Any]]:
    parts = [_load(shards, first, n // 2, keys) for shards in pair]
    both = [np.stack([part[key] for part in parts], axis=1) for key in keys]
    return [array.reshape(-1, *array.shape[2:]) for array in both]


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
    parts = [
        shards.read(_name(at, min(at + _CHUNK, first + n)))
        for at in range(first, first + n, _CHUNK)
    ]
    return {key: np.concatenate([p[key] for p in parts]) for key in keys}


def _chunk(job: tuple[ElementSpec, str, int, int]) -> dict[str, NDArray[Any]]:
    spec, body, first, last = job
    made = [element(spec, body, k) for k in range(first, last)]

    def levels(maps: list[NDArray[np.float32]]) -> NDArray[np.uint8]:
        return np.rint(np.stack(maps) * _LEVELS).astype(np.uint8)

    return {
        "vector": np.stack([e.vector for e in made]),
        "mu": levels([e.mu for e in made]),
        "range_time": levels([e.range_time for e in made]),
        "in_view": np.array([e.in_view for e in made], np.float32),
    }


def _pair(folder: Path, spec: ElementSpec, cell: Cell) -> tuple[ShardSet, ShardSet]:
    return _shards(folder, spec, cell.animal), _shards(folder, spec, "human")


def _shards(folder: Path, spec: ElementSpec, body: str) -> ShardSet:
    about = asdict(spec)
    digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:8]
    name = f"{body}-{spec.frame_rate_hz}-{digest}"
    return ShardSet(folder / name, {"set": "thesis elements", "body": body, **about})


def _name(first: int, last: int) -> str:
    return f"{first:07d}-{last:07d}"
