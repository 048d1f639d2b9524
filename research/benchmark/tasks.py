"""The tasks: the thesis' eight sets, fixed by a version; they give everybody the same data.

A task is one of the sets of tables 4.2 of the thesis: people against dogs or cats, 60 or 200
frames a second, with the thesis' type 1 or type 2 vector. Beside the vector every element has
the two maps that the daemon makes of the same frames; an entry takes what it likes.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from x2train.thesis.cells import CELLS, Cell
from x2train.thesis.elements import ElementSpec
from x2train.thesis.recipe import FRESH_FROM
from x2train.thesis.sets import load_cell, load_maps, make_bodies

VERSION = "thesis-1"
"""Of the data and of what counts; results of different versions are not compared."""
SEED = 0
"""Of every draw: that of docs/thesis-results.md, so that its shards serve here as well."""
FULL = 5000
"""Elements of a set, and fresh ones that judge: the thesis' number."""

Tell = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True, eq=False)
class Elements:
    """Two-second records of one body each, person and animal in turn.

    Attributes
    ----------
    vector : ndarray, shape (n, 784) or (n, 1176), float32
        The thesis' type 1 or type 2 vector.
    mu : ndarray, shape (n, 28, 40), float32
        Micro-Doppler spectrogram, 0 to 1 for 30 dB; rows ascend in velocity, cells of 50 ms.
    range_time : ndarray, shape (n, 56, 40), float32
        Power of what moves by cells of 50 mm, 0 to 1 for 30 dB.
    is_person : ndarray, shape (n,), bool
        The truth.
    in_view : ndarray, shape (n,), float32
        Share of the time with the torso in the swath.
    frame_rate_hz : int
        60 or 200.
    """

    vector: NDArray[np.float32]
    mu: NDArray[np.float32]
    range_time: NDArray[np.float32]
    is_person: NDArray[np.bool_]
    in_view: NDArray[np.float32]
    frame_rate_hz: int

    def __len__(self) -> int:
        return len(self.is_person)


@dataclass(frozen=True, slots=True)
class Task:
    """One task, and how much of it is used."""

    cell: Cell
    n_train: int = FULL
    n_test: int = FULL

    def __post_init__(self) -> None:
        """Validate the sizes."""
        for name, n in (("n_train", self.n_train), ("n_test", self.n_test)):
            if not 40 <= n <= 2 * FRESH_FROM or n % 2:
                msg = f"{name} {n}: must be even, 40 to {2 * FRESH_FROM}"
                raise UsageError(msg)

    @property
    def name(self) -> str:
        """As the thesis calls it: T1D60."""
        return self.cell.name

    @property
    def spec(self) -> ElementSpec:
        """What its elements are drawn from."""
        return ElementSpec(frame_rate_hz=self.cell.frame_rate_hz, seed=SEED)

    def make(self, folder: Path, tell: Tell, workers: int = 1) -> None:
        """Simulate what is not there yet."""
        for body in (*self.cell.bodies, "human"):
            for first, n in ((0, self.n_train // 2), (FRESH_FROM, self.n_test // 2)):
                what = f"{body} at {self.cell.frame_rate_hz} Hz"

                def report(done: int, total: int, what: str = what) -> None:
                    tell(what, done, total)

                make_bodies(folder, self.spec, body, first, n, workers=workers, tell=report)

    def train(self, folder: Path) -> Elements:
        """Return the elements to train with."""
        return self._load(folder, 0, self.n_train)

    def test(self, folder: Path) -> Elements:
        """Return the elements that judge, which no training set reaches."""
        return self._load(folder, FRESH_FROM, self.n_test)

    def _load(self, folder: Path, first: int, n: int) -> Elements:
        vectors = load_cell(folder, self.spec, self.cell, first, n)
        maps, _ = load_maps(folder, self.spec, self.cell, first, n)
        return Elements(
            vectors.x,
            maps["mu"],
            maps["range_time"],
            vectors.y == 1,
            vectors.in_view,
            self.cell.frame_rate_hz,
        )


def tasks_named(names: str | None, n_train: int, n_test: int) -> tuple[Task, ...]:
    """Return the tasks of a list such as ``T1D60,T2C200``, or all eight.

    Raises UsageError for a name that is none.

    >>> [task.name for task in tasks_named("T2D60", 100, 100)]
    ['T2D60']
    """
    known = {cell.name: cell for cell in CELLS}
    wanted = list(known) if names is None else [name.strip() for name in names.split(",")]
    for name in wanted:
        if name not in known:
            msg = f"task '{name}': known are {', '.join(known)}"
            raise UsageError(msg)
    return tuple(Task(known[name], n_train, n_test) for name in wanted)
