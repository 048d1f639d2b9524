"""The tasks of `thesis-1`: the thesis' eight sets, who enters, and what counts.

A task is one of the sets of tables 4.2 of the thesis: people against dogs or cats, 60 or 200
frames a second, with the thesis' type 1 or type 2 vector. Beside the vector every element has
the two maps that the daemon makes of the same frames; an entry takes what it likes.

An entry is a file with a function ``scores(train, test, seed)``: it takes two `Elements`, may look
at everything in `train` and at all but `is_person` and `in_view` of `test`, and returns the
probability of a person for every element of `test`, shape (n,), 0 to 1. One with USES_VECTOR
False gets no vectors, and runs once for tasks that differ in them alone. A bundle is not trained
here: it judges each element as the first window of a stream, without any before it, and says how
much of p(human) + p(pet) is p(human).
"""

import importlib.util
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from radard.detect.clutter_map import ClutterRemover
from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.features import extract
from radard.stream.ring import Dwell
from x2radar.atomic import write_atomically
from x2train.judge.estimates import Ranking, share
from x2train.thesis.elements import ElementSpec, dwell
from x2train.thesis.recipe import FRESH_FROM, IN_VIEW
from x2train.thesis.sets import CELLS, Cell, load_cell, load_maps

VERSION = "thesis-1"
"""Of the data and of what counts; results of different versions are not compared."""
SEED = 0
"""Of every draw: that of docs/thesis-results.md, so that its shards serve here as well."""
FULL = 5000
"""Elements of a set, and fresh ones that judge: the thesis' number."""
ENTRIES = Path(__file__).parent / "entries"
_MIN_P = 1e-6  # below it a probability counts as so much: a certain mistake costs 14 nats

Scores = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Elements:
    """Records of one body each, 2 s of spectrogram columns, person and animal in turn."""

    vector: NDArray[np.float32]  # (n, 784) or (n, 1176): the thesis' type 1 or type 2 vector
    # (n, 28, 40): micro-Doppler spectrogram, 0 to 1 for 30 dB; rows ascend in velocity, cells of
    # 50 ms
    mu: NDArray[np.float32]
    range_time: NDArray[np.float32]  # (n, 56, 40): power of what moves by cells of 50 mm, likewise
    is_person: NDArray[np.bool_]  # (n,): the truth
    in_view: NDArray[np.float32]  # (n,): share of the time with the torso in the swath
    frame_rate_hz: int  # 60 or 200

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
    def spec(self) -> ElementSpec:
        """What its elements are drawn from."""
        return ElementSpec(frame_rate_hz=self.cell.frame_rate_hz, seed=SEED)

    def train(self, folder: Path) -> Elements:
        """Return the elements to train with."""
        return self._load(folder, 0, self.n_train)

    def test(self, folder: Path) -> Elements:
        """Return the elements that judge, which no training set reaches."""
        return self._load(folder, FRESH_FROM, self.n_test)

    def _load(self, folder: Path, first: int, n: int) -> Elements:
        vectors = load_cell(folder, self.spec, self.cell, first, n)
        maps, _ = load_maps(folder, self.spec, self.cell, first, n)
        rate_hz = self.cell.frame_rate_hz
        is_person = vectors.y == 1
        return Elements(
            vectors.x, maps["mu"], maps["range_time"], is_person, vectors.in_view, rate_hz
        )


def tasks_named(names: str | None, n_train: int, n_test: int) -> tuple[Task, ...]:
    """Return the tasks of a list such as ``T1D60,T2C200``, or all eight; UsageError if unknown."""
    known = {cell.name: cell for cell in CELLS}
    wanted = list(known) if names is None else [name.strip() for name in names.split(",")]
    for name in wanted:
        if name not in known:
            msg = f"task '{name}': known are {', '.join(known)}"
            raise UsageError(msg)
    return tuple(Task(known[name], n_train, n_test) for name in wanted)


@dataclass(frozen=True, slots=True)
class Entrant:
    """One method."""

    name: str  # for tables and file names
    title: str  # for people
    # takes the task, the folder of its data and a seed; returns p(person) of its test
    run: Callable[[Task, Path, int], Scores]
    kept_as: str = ""  # its scores of earlier runs; empty where nobody knows that it is the same


def shipped(function: str = "scores") -> tuple[str, ...]:
    """Return the names of the entries of this folder that have such a function."""
    names = sorted(path.stem for path in ENTRIES.glob("*.py"))
    return tuple(name for name in names if hasattr(module_of(entry_file(name)), function))


def entry_file(text: str) -> str:
    """Return the file of an entry of this folder; another text as it is."""
    own = ENTRIES / f"{text}.py"
    return str(own) if own.is_file() else text


def is_function(text: str) -> bool:
    """Return whether an entry's text means a function: ``FILE.py`` or ``FILE.py:FUNCTION``."""
    return text.partition(":")[0].endswith(".py")


def module_of(text: str) -> ModuleType:
    """Return the module of ``FILE.py[:FUNCTION]``; its code runs here."""
    path = Path(text.partition(":")[0])
    if not path.is_file():
        msg = f"entry '{path}': no such file"
        raise UsageError(msg)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None  # noqa: S101 - its name ends in .py
    assert spec.loader is not None  # noqa: S101
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def function_of(text: str, default: str) -> Callable[..., object]:
    """Return the function of ``FILE.py[:FUNCTION]``; `default` is its name where none is given.

    Raises UsageError if there is none.
    """
    file, _, name = text.partition(":")
    made = getattr(module_of(text), name or default, None)
    if not callable(made):
        msg = f"entry '{file}': has no function '{name or default}'"
        raise UsageError(msg)
    return made  # type: ignore[no-any-return]


def title_of(text: str) -> str:
    """Return what the file of ``FILE.py[:FUNCTION]`` calls its method: TITLE, else its name."""
    return str(getattr(module_of(text), "TITLE", Path(text.partition(":")[0]).stem))


def entrant_named(text: str) -> Entrant:
    """Return what ``NAME``, ``FILE.py[:FUNCTION]``, ``BUNDLE.onnx`` or a bundle's name means.

    Raises UsageError if it is none of them; BundleError and ModelMismatch are a bundle's.
    """
    file = entry_file(text)
    if is_function(file):
        uses_vector = bool(getattr(module_of(file), "USES_VECTOR", True))
        run = trained(function_of(file, "scores"), uses_vector=uses_vector)
        name = Path(file.partition(":")[0]).stem
        return Entrant(name, title_of(file), run, kept_as=name if file != text else "")
    bundle = load_bundle(text)
    key = f"{bundle.name}-{bundle.judges_as[:12]}"
    return Entrant(bundle.name, f"bundle {bundle.name}, as it is", _judged_by(text), kept_as=key)


def trained(scores: Callable[..., object], *, uses_vector: bool) -> Callable[..., Scores]:
    """Return what runs an entry's function on a task, without what it must not see."""

    def run(task: Task, folder: Path, seed: int) -> Scores:
        train, test = task.train(folder), task.test(folder)
        hidden = replace(
            test, is_person=np.zeros(len(test), np.bool_), in_view=np.ones(len(test), np.float32)
        )
        if not uses_vector:
            train = replace(train, vector=np.empty((len(train), 0), np.float32))
            hidden = replace(hidden, vector=np.empty((len(test), 0), np.float32))
        return np.asarray(scores(train, hidden, seed), np.float64)

    return run if uses_vector else _once(run)


def _once(run: Callable[[Task, Path, int], Scores]) -> Callable[[Task, Path, int], Scores]:
    """Return `run` for those to whom tasks that differ in the vector alone are the same."""
    known: dict[tuple[Task, Path, int], Scores] = {}

    def once(task: Task, folder: Path, seed: int) -> Scores:
        frames = (replace(task, cell=replace(task.cell, vector=1)), folder, seed)
        if frames not in known:
            known[frames] = run(*frames)
        return known[frames]

    return once


def _judged_by(name: str) -> Callable[[Task, Path, int], Scores]:
    def run(task: Task, _folder: Path, _seed: int) -> Scores:
        classifier = Classifier(load_bundle(name))
        return np.array([_person_by(classifier, each) for each in test_dwells(task)])

    return _once(run)


def test_dwells(task: Task) -> Iterator[Dwell]:
    """Yield the frames of the elements that judge, animal and person in turn."""
    for k in range(task.n_test // 2):
        for body in (task.cell.bodies[k % len(task.cell.bodies)], "human"):
            yield dwell(task.spec, body, FRESH_FROM + k)[0]


def _person_by(classifier: Classifier, made: Dwell) -> float:
    bundle = classifier.bundle
    bundle.check_stream(made.axis, made.frame_rate_hz)
    settings = bundle.features.at(made.frame_rate_hz)
    # The ring keeps every so many bins behind the matched filter; here they are left out.
    step = settings.range_step(made.axis)
    rows = np.ascontiguousarray(made.frames[:, ::step])
    axis = replace(made.axis, n_range=rows.shape[1], bin_length_m=made.axis.bin_length_m * step)
    thin = replace(made, frames=rows, axis=axis, end_frame=len(rows))
    if settings.clutter == "removed":
        thin = ClutterRemover().remove(thin)
    p = classifier.answer(extract(thin, settings, classifier.feature_names)).window
    return p.human / max(p.human + p.pet, 1e-9)


@dataclass(frozen=True, slots=True)
class Score:
    """One entrant's result on one task."""

    version: str
    task: str
    entry: str
    title: str
    n_train: int
    n_test: int
    seed: int
    # share of right answers at p(person) 0.5, and its 95 % interval (Clopper-Pearson)
    accuracy: float
    low: float
    high: float
    auc: float  # probability that a person scores above an animal
    cross_entropy: float  # mean of -ln p(true class), in nats
    accuracy_in_view: float  # of those whose torso is in the swath for a quarter of the time


def score(task: Task, entrant: Entrant, seed: int, p: Scores, test: Elements) -> Score:
    """Return what probabilities of a person are worth.

    Raises UsageError if they are no probabilities of these elements.
    """
    if p.shape != (len(test),) or not np.isfinite(p).all() or p.min() < 0 or p.max() > 1:
        msg = f"entry '{entrant.name}': {task.cell.name} wants {len(test)} probabilities, 0 to 1"
        raise UsageError(msg)
    truth = test.is_person
    right = (p > 0.5) == truth
    found = share(int(right.sum()), len(right))
    of_truth = np.clip(np.where(truth, p, 1 - p), _MIN_P, 1.0)
    seen = right[test.in_view >= IN_VIEW]
    auc, cross_entropy = Ranking(p, truth).auc(), -np.log(of_truth).mean()
    figures = (*found, auc, cross_entropy, seen.mean())
    return Score(
        VERSION,
        task.cell.name,
        entrant.name,
        entrant.title,
        task.n_train,
        task.n_test,
        seed,
        *(round(float(x), 4) for x in figures),
    )


class Kept:
    """Scores on disk, one file for each."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def load(self, task: Task, key: str, seed: int) -> Score | None:
        """Return a score of an earlier run; `key` is what the entry is kept as."""
        path = self._path(task, key, seed)
        return Score(**json.loads(path.read_text("utf-8"))) if path.is_file() else None

    def save(self, task: Task, key: str, made: Score) -> None:
        """Keep a score."""
        self._folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(asdict(made), indent=1) + "\n"
        write_atomically(self._path(task, key, made.seed), text.encode())

    def largest(self, seed: int) -> list[Score]:
        """Return of every entry the scores of its largest size, those of most tasks first.

        Raises UsageError if nothing is kept.
        """
        found: dict[tuple[str, int, int], dict[str, Score]] = {}
        paths = self._folder.glob(f"{VERSION}-*-{seed}.json")
        # Of one task the newest: a bundle of the same name may have been another.
        for path in sorted(paths, key=lambda p: p.stat().st_mtime_ns):
            made = Score(**json.loads(path.read_text("utf-8")))
            found.setdefault((made.entry, made.n_train, made.n_test), {})[made.task] = made
        if not found:
            msg = f"{self._folder}: no scores of {VERSION} with seed {seed} are kept"
            raise UsageError(msg)
        best: dict[str, dict[str, Score]] = {}
        for (entry, *_), own in sorted(found.items(), key=lambda e: (len(e[1]), e[0][1:])):
            best[entry] = own
        order = sorted(best.values(), key=lambda own: sum(s.accuracy for s in own.values()))
        names = [cell.name for cell in CELLS]
        return [own[name] for own in order for name in names if name in own]

    def _path(self, task: Task, key: str, seed: int) -> Path:
        size = f"{task.n_train}-{task.n_test}"
        return self._folder / f"{VERSION}-{task.cell.name}-{key}-{size}-{seed}.json"
