"""What counts: accuracy on elements that nobody trained on, and what comes with it."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from radard.config.atomic import write_atomically
from radard.errors import UsageError
from research.benchmark.tasks import VERSION, Elements, Task
from x2train.report.intervals import wilson
from x2train.thesis.cells import CELLS
from x2train.thesis.results import IN_VIEW

_LEAST_P = 1e-6
"""Below it a probability counts as so much: a certain mistake costs 14 nats. Chosen."""


@dataclass(frozen=True, slots=True)
class Score:
    """One entrant's result on one task.

    Attributes
    ----------
    accuracy, low, high : float
        Share of right answers at p(person) 0.5, and its 95 % interval (Wilson).
    auc : float
        Probability that a person scores above an animal.
    cross_entropy : float
        Mean of -ln p(true class), in nats.
    accuracy_in_view : float
        Of those whose torso is in the swath for a quarter of the time.
    """

    version: str
    task: str
    entry: str
    title: str
    n_train: int
    n_test: int
    seed: int
    accuracy: float
    low: float
    high: float
    auc: float
    cross_entropy: float
    accuracy_in_view: float


def score(
    task: Task, entry: tuple[str, str], seed: int, p: NDArray[np.float64], test: Elements
) -> Score:
    """Return what probabilities of a person are worth; `entry` is name and title.

    Raises UsageError if they are no probabilities of these elements.
    """
    if p.shape != (len(test),) or not np.isfinite(p).all() or p.min() < 0 or p.max() > 1:
        msg = f"entry '{entry[0]}': {task.name} wants {len(test)} probabilities, 0 to 1"
        raise UsageError(msg)
    truth = test.is_person
    right = (p > 0.5) == truth
    share = wilson(int(right.sum()), len(right))
    of_truth = np.clip(np.where(truth, p, 1 - p), _LEAST_P, 1.0)
    ranks = stats.rankdata(p)
    n_person, n_animal = int(truth.sum()), int((~truth).sum())
    wins = ranks[truth].sum() - n_person * (n_person + 1) / 2
    return Score(
        VERSION,
        task.name,
        *entry,
        task.n_train,
        task.n_test,
        seed,
        round(share.value, 4),
        round(share.low, 4),
        round(share.high, 4),
        round(float(wins / (n_person * n_animal)), 4),
        round(float(-np.log(of_truth).mean()), 4),
        round(float(right[test.in_view >= IN_VIEW].mean()), 4),
    )


def _read(path: Path) -> Score | None:
    try:
        return Score(**json.loads(path.read_text("utf-8")))
    except (OSError, ValueError, TypeError):
        return None


class Kept:
    """Scores on disk, one file for each."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def load(self, task: Task, key: str, seed: int) -> Score | None:
        """Return a score of an earlier run; `key` is what the entry is kept as."""
        return _read(self._path(task, key, seed))

    def largest(self, seed: int) -> list[Score]:
        """Return of every entry the scores of its largest size, those of most tasks first.

        Raises UsageError if nothing is kept.
        """
        found: dict[tuple[str, int, int], dict[str, Score]] = {}
        paths = sorted(self._folder.glob(f"{VERSION}-*.json"), key=lambda p: p.stat().st_mtime_ns)
        for path in paths:
            made = _read(path)
            if made is not None and (made.version, made.seed) == (VERSION, seed):
                # Of one task the newest: a bundle of the same name may have been another.
                size = (made.entry, made.n_train, made.n_test)
                found.setdefault(size, {})[made.task] = made
        if not found:
            msg = f"{self._folder}: no scores of {VERSION} with seed {seed} are kept"
            raise UsageError(msg)
        best: dict[str, dict[str, Score]] = {}
        for (entry, *_), own in sorted(found.items(), key=lambda e: (len(e[1]), e[0][1:])):
            best[entry] = own
        order = sorted(best.values(), key=lambda own: sum(s.accuracy for s in own.values()))
        names = [cell.name for cell in CELLS]
        return [own[name] for own in order for name in names if name in own]

    def save(self, task: Task, key: str, made: Score) -> None:
        """Keep a score."""
        self._folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(asdict(made), indent=1) + "\n"
        write_atomically(self._path(task, key, made.seed), text.encode())

    def _path(self, task: Task, key: str, seed: int) -> Path:
        name = f"{VERSION}-{task.name}-{key}-{task.n_train}-{task.n_test}-{seed}.json"
        return self._folder / name
