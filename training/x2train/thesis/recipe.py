"""The recipe: data sets, trainings and switches of the thesis, each made once and kept."""

import json
import statistics
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.config.json_file import parse_json
from radard.errors import UsageError
from x2radar.atomic import write_whole
from x2train.sets.workers import Crew
from x2train.thesis.elements import ElementSpec
from x2train.thesis.fit import FitSettings, Fitted, Tell, fit, of_truth
from x2train.thesis.sets import CELLS, Cell, CellData, load_cell, make_bodies

FRESH_FROM = 1_000_000  # number of the first fresh element: no training set reaches it
IN_VIEW = 0.25  # of the time: half a second
_STOP_SHARE = 20  # one in so many training elements scores instead, when there are no recordings
_SHORT_S = 2.0 - 27 / 60  # of columns that 2 s of frames make at 60 Hz, M = 28; 2.45 s make 2 s
_RETRAIN_RATE = 0.25  # of the learning rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A configuration of a cell: its training, and switches of its data."""

    label: str  # short, for tables and file names
    fit: FitSettings
    # switches of the data
    rectified: bool = False
    clutter: bool = False
    noise: str = "input"  # as in `ElementSpec`
    train_rate_hz: int | None = None  # train on sets of another frame rate than the cell's
    dwell_s: float = 2.0  # of spectrogram columns
    # train on all nine tenths, as the thesis did, and let the elements that evaluate stop it
    trains_on_all: bool = False
    draws_classes: bool = False  # of training elements, by chance instead of in turn


def variants(base: FitSettings) -> tuple[Variant, ...]:
    """Return the rows of section 7: what the thesis leaves to be tried, one at a time."""
    bare: dict[str, Any] = {"pretrain_epochs": (), "output_epochs": 0}
    # The thesis' own (3.5). Behind autoencoders of unit-norm inputs most repeats stay on a
    # plateau, 50 %, with ReLU units at a rate of 0.05 as with sigmoid units.
    momentum: dict[str, Any] = {"optimiser": "momentum", "learning_rate": 0.05, "decay": 1e-4}
    of_data: dict[str, dict[str, Any]] = {
        "rectified profile": {"rectified": True},
        "static clutter": {"clutter": True},
        "noise as printed": {"noise": "printed"},
        "trained at 200 Hz": {"train_rate_hz": 200},
        "2 s of frames": {"dwell_s": _SHORT_S},
        "all 4500 train": {"trains_on_all": True},
        "classes drawn": {"draws_classes": True},
    }
    of_training: dict[str, dict[str, Any]] = {
        "single output": {"n_outputs": 1},
        "layers 200-100": {"layers": (200, 100)},
        "layers 50-25": {"layers": (50, 25)},
        "one layer of 100": {"layers": (100,), "pretrain_epochs": base.pretrain_epochs[:1]},
        "tanh": {"activation": "tanh"},
        "mean square error": {"error": "mse"},
        "momentum SGD": momentum,
        "momentum SGD, no pre-training": momentum | bare,
        "L-BFGS": {"optimiser": "lbfgs", "decay": 1e-4},
        "no L2": {"decay": 0.0},
        "no weight averaging": {"averaging": 0.0},
        "sparse codes": {"sparsity": 0.1},
        "no pre-training": bare,
        "inputs scaled each": {"scaling": "each"},
    }
    return (
        *(Variant(label=label, fit=base, **how) for label, how in of_data.items()),
        *(Variant(label=label, fit=replace(base, **how)) for label, how in of_training.items()),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRecipe:
    """Folders and sizes of the whole study."""

    folder: Path  # of data, results and checkpoints
    n_elements: int = 5000  # of a data set; a tenth of it evaluates
    n_fresh: int = 5000  # further elements that judge
    seed: int = 0
    # M and I alpha
    n_cpi: int = 28
    n_cadence: int = 28
    workers: int = 1  # processes that simulate

    def __post_init__(self) -> None:
        """Validate the settings."""
        for name, least in (("n_elements", 40), ("n_fresh", 2), ("seed", 0), ("workers", 1)):
            if getattr(self, name) < least:
                msg = f"{name.removeprefix('n_')} {getattr(self, name)}: must be at least {least}"
                raise UsageError(msg)
        if self.n_elements // 2 > FRESH_FROM:
            raise UsageError(f"elements {self.n_elements}: must be at most {2 * FRESH_FROM}")

    @property
    def n_train(self) -> int:
        """Elements before the thesis' evaluation part."""
        return self.n_elements - max(2, self.n_elements // 10 // 2 * 2)

    def spec(self, rate_hz: int, variant: Variant | None = None) -> ElementSpec:
        """Return what the elements of a rate are drawn from."""
        names = ("clutter", "noise", "dwell_s") if variant else ()
        own: dict[str, Any] = {name: getattr(variant, name) for name in names}
        own |= {"n_cpi": self.n_cpi, "n_cadence": self.n_cadence}
        return ElementSpec(frame_rate_hz=rate_hz, seed=self.seed, **own)

    def make(self, spec: ElementSpec, cell: Cell, tell: Tell) -> None:
        """Make the elements that a cell needs of one rate."""
        for body in (*cell.bodies, "human"):
            for first, n in ((0, self.n_elements // 2), (FRESH_FROM, self.n_fresh // 2)):
                text = f"simulate {body} at {spec.frame_rate_hz} Hz"
                crew = Crew(self.workers, report=partial(tell, text))
                make_bodies(self.folder, spec, body, first, n, crew=crew)

    def load(self, cell: Cell, variant: Variant) -> tuple[CellData, CellData, CellData]:
        """Return what trains, what evaluates, and the fresh elements."""

        def elements(rate_hz: int, first: int, n: int) -> CellData:
            spec = self.spec(rate_hz, variant)
            return load_cell(self.folder, spec, cell, first, n, rectified=variant.rectified)

        own_hz, other_hz = cell.frame_rate_hz, variant.train_rate_hz
        whole = elements(own_hz, 0, self.n_elements)
        train = elements(other_hz, 0, self.n_elements) if other_hz else whole
        train = train.part(0, self.n_train)
        if variant.draws_classes:
            train = drawn_classes(train, np.random.default_rng(self.seed))
        evaluate = whole.part(self.n_train, self.n_elements)
        return train, evaluate, elements(own_hz, FRESH_FROM, self.n_fresh)

    def train(
        self, cell: Cell, variant: Variant, tell: Tell, recordings: CellData | None = None
    ) -> tuple[Fitted, CellData, CellData, str]:
        """Train one configuration; `tell` gets what is done, how far, of how much.

        Returns the training, what evaluates it, fresh elements, and what stopped it.
        Labelled recordings, if given, are the score that stops training, as in the thesis; then
        half of them retrain the network, and the other half scores.
        """
        for rate_hz in {cell.frame_rate_hz, variant.train_rate_hz or cell.frame_rate_hz}:
            self.make(self.spec(rate_hz, variant), cell, tell)
        train, evaluate, fresh = self.load(cell, variant)
        if variant.trains_on_all:
            stop, stopped_by = evaluate, f"the {len(evaluate.y)} evaluation elements"
        elif recordings is None:
            train, stop, stopped_by = with_stop(train)
        else:
            stop, stopped_by = recordings, f"{len(recordings.y)} windows of recordings"
        named: Tell = lambda what, *far: tell(f"{cell.name} {what}", *far)  # noqa: E731
        fitted = fit(train, stop, variant.fit, tell=named)
        if recordings is not None:
            n = len(recordings.y)
            half, rest = recordings.part(0, n // 2), recordings.part(n // 2, n)
            rate = variant.fit.learning_rate * _RETRAIN_RATE
            short = replace(variant.fit, learning_rate=rate)
            fitted = fit(half, rest, short, start=fitted, tell=named)
            stopped_by = f"{len(rest.y)} windows of recordings, after retraining on {len(half.y)}"
        return fitted, evaluate, fresh, stopped_by


@dataclass(frozen=True, slots=True)
class SetResult:
    """Scores of the repeats on one set of elements."""

    n: int
    total: tuple[float, ...]
    class1: tuple[float, ...]
    class2: tuple[float, ...]
    cross_entropy: tuple[float, ...]
    confusion: tuple[tuple[tuple[int, int], tuple[int, int]], ...]

    @property
    def median(self) -> float:
        """Median of the repeats' total accuracy."""
        return statistics.median(self.total)


@dataclass(frozen=True, slots=True)
class CellResult:
    """What one configuration reached on one set of the thesis."""

    name: str
    label: str  # what differs from the thesis' configuration; its activation in the main tables
    best: int  # which repeat had the best score while it trained
    epochs: tuple[int, ...]  # looks that were best, of each repeat
    # the thesis' 500 elements, fresh ones, and those of the fresh ones in the swath for at least
    # a quarter of the time
    evaluation: SetResult
    fresh: SetResult
    in_view: SetResult
    stopped_by: str  # what the score was computed on
    settings: Mapping[str, Any] = field(default_factory=dict)
    # of every look and repeat: cross-entropy, and the mean probability of the true class of pets
    # and of people, on what stopped the training; the first before it began
    scores: tuple[tuple[float, ...], ...] = ()
    confidence: tuple[tuple[tuple[float, ...], ...], ...] = ()


def judged(p: NDArray[np.float64], y: NDArray[np.int64]) -> SetResult:
    """Return what probabilities of shape (n_repeats, n, 2) are worth."""
    said = p.argmax(axis=2)
    right = said == y
    confusion = tuple(
        tuple(tuple(int(((row == out) & (y == true)).sum()) for true in (0, 1)) for out in (0, 1))
        for row in said
    )

    def percent(which: NDArray[np.bool_] | slice) -> tuple[float, ...]:
        return tuple(float(round(100 * r[which].mean(), 2)) for r in right)

    return SetResult(
        len(y),
        percent(slice(None)),
        percent(y == 0),
        percent(y == 1),
        tuple(float(round(v, 4)) for v in of_truth(p, y)[1]),
        confusion,  # type: ignore[arg-type]
    )


def scores(
    p_evaluate: NDArray[np.float64], y: NDArray[np.int64], p: NDArray[np.float64], fresh: CellData
) -> dict[str, SetResult]:
    """Return what a network says of elements that evaluate, with labels `y`, and of fresh ones."""
    which = fresh.in_view >= IN_VIEW
    return {
        "evaluation": judged(p_evaluate, y),
        "fresh": judged(p, fresh.y),
        "in_view": judged(p[:, which], fresh.y[which]),
    }


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """One training that is due; its result is kept, one JSON file each."""

    folder: Path
    name: str  # of the set
    label: str  # what differs
    settings: dict[str, Any]  # everything that the result depends on
    train: Callable[[Tell], dict[str, Any]]  # returns what else is in the result

    @property
    def _path(self) -> Path:
        file = f"{self.name}-{self.label.replace(' ', '-').lower()}.json"
        return self.folder / "results" / file

    def kept(self) -> CellResult | None:
        """Return the result of an earlier run of the same settings; UsageError if cut short."""
        if not self._path.exists():
            return None
        try:
            known = parse_json(CellResult, self._path.read_bytes())
        except ValueError as err:
            msg = f"{self._path}: no result ({err}); remove it to make it again"
            raise UsageError(msg) from err
        return known if known.settings == json.loads(json.dumps(self.settings)) else None

    def run(self, tell: Tell) -> CellResult:
        """Train, or return what was kept."""
        if (known := self.kept()) is not None:
            return known
        made = self.train(tell)
        result = CellResult(name=self.name, label=self.label, settings=self.settings, **made)
        self._path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(self._path, json.dumps(asdict(result)).encode())
        return result


def reached(
    fitted: Fitted, look_every: int, evaluate: CellData, fresh: CellData, stopped_by: str
) -> dict[str, Any]:
    """Return what a network in repeats has reached."""
    return {
        "best": fitted.best_repeat,
        "epochs": tuple(int(k) * look_every for k in fitted.best_looks),
        **scores(fitted.predict(evaluate.x), evaluate.y, fitted.predict(fresh.x), fresh),
        "stopped_by": stopped_by,
    }


def network_job(
    recipe: StudyRecipe, cell: Cell, variant: Variant, recordings: CellData | None = None
) -> Job:
    """Return the training of the thesis' network on one set; windows stop it and retrain it."""

    def train(tell: Tell) -> dict[str, Any]:
        fitted, evaluate, fresh, stopped_by = recipe.train(cell, variant, tell, recordings)
        looks = fitted.confidence.round(4).tolist()
        return {
            **reached(fitted, variant.fit.look_every, evaluate, fresh, stopped_by),
            "scores": tuple(map(tuple, fitted.scores.round(4).tolist())),
            "confidence": tuple(tuple(map(tuple, look)) for look in looks),
        }

    settings = {
        **asdict(variant),
        "elements": recipe.n_elements,
        "fresh": recipe.n_fresh,
        "seed": recipe.seed,
        "n_cpi": recipe.n_cpi,
        "n_cadence": recipe.n_cadence,
        "recordings": sha256(recordings.x.tobytes()).hexdigest() if recordings else "",
    }
    return Job(recipe.folder, cell.name, variant.label, settings, train)


def wanted_cells(vector: int | None, animal: str | None, rate_hz: int | None) -> list[Cell]:
    """Return those of the thesis' cells that are asked for, at any frame rate; None for all."""
    cells = [c for c in CELLS if vector in {None, c.vector} and animal in {None, c.animal}]
    if rate_hz is not None:
        cells = [replace(cell, frame_rate_hz=rate_hz) for cell in cells]
    return list(dict.fromkeys(cells))


def drawn_classes(data: CellData, rng: np.random.Generator) -> CellData:
    """Return elements whose classes are drawn by chance, as far as either class reaches."""
    wanted = rng.integers(2, size=len(data.y))
    rank = np.where(wanted == 1, np.cumsum(wanted), np.cumsum(1 - wanted)) - 1
    reaches = np.logical_and.accumulate(rank < len(data.y) // 2)
    rows = (2 * rank + wanted)[reaches]
    return CellData(data.x[rows], data.y[rows], data.in_view[rows])


def with_stop(train: CellData) -> tuple[CellData, CellData, str]:
    """Return what trains, what stops the training, and the name of that."""
    n_fit = len(train.y) - max(2, len(train.y) // _STOP_SHARE // 2 * 2)
    stop = train.part(n_fit, len(train.y))
    return train.part(0, n_fit), stop, f"a validation part of {len(stop.y)} training elements"
