"""Who enters: the entries of this folder, a function of a file, or a bundle.

A bundle is not trained here: it judges each element as the first window of a stream, without
any before it, and says how much of p(human) + p(pet) is p(human).
"""

import importlib.util
import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.classify.bundle import load_bundle
from radard.classify.classifier import Classifier
from radard.classify.features import extract
from radard.detect.clutter_map import ClutterRemover
from radard.errors import UsageError
from radard.pipeline import COARSE_BIN_M, settings_at
from radard.stream.ring import Dwell
from x2train.studies.benchmark import entries
from x2train.studies.benchmark.tasks import Elements, Task
from x2train.studies.thesis.elements import dwell
from x2train.studies.thesis.recipe import FRESH_FROM

Scores = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Entrant:
    """One method."""

    name: str
    """For tables and file names."""
    title: str
    """For people."""
    run: Callable[[Task, Path, int], Scores]
    """Takes the task, the folder of its data and a seed; returns p(person) of its test."""
    is_bundle: bool = False


def shipped() -> tuple[str, ...]:
    """Return the names of the entries of this folder."""
    return tuple(found.name for found in pkgutil.iter_modules(entries.__path__))


def entrant_named(text: str) -> Entrant:
    """Return what ``NAME``, ``FILE.py[:FUNCTION]``, ``BUNDLE.onnx`` or a bundle's name means.

    Raises UsageError if it is none of them; BundleError and ModelMismatch are a bundle's.
    """
    if text in shipped():
        module = import_module(f"{entries.__name__}.{text}")
        return Entrant(text, module.TITLE, _trained(module.scores))
    file, _, function = text.partition(":")
    if file.endswith(".py"):
        return _of_file(Path(file), function or "scores")
    bundle = load_bundle(text)
    title = f"bundle {bundle.name}, as it is"
    return Entrant(bundle.name, title, _judged_by(text), is_bundle=True)


def _trained(scores: Callable[[Elements, Elements, int], Any]) -> Callable[..., Scores]:
    def run(task: Task, folder: Path, seed: int) -> Scores:
        test = task.test(folder)
        # What an entry must not see.
        hidden = replace(
            test, is_person=np.zeros(len(test), np.bool_), in_view=np.ones(len(test), np.float32)
        )
        return np.asarray(scores(task.train(folder), hidden, seed), np.float64)

    return run


def _of_file(path: Path, function: str) -> Entrant:
    if not path.is_file():
        msg = f"entry '{path}': no such file"
        raise UsageError(msg)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None  # noqa: S101 - its name ends in .py
    assert spec.loader is not None  # noqa: S101
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    scores = getattr(module, function, None)
    if not callable(scores):
        msg = f"entry '{path}': has no function '{function}'"
        raise UsageError(msg)
    return Entrant(path.stem, str(getattr(module, "TITLE", path.stem)), _trained(scores))


def _judged_by(name: str) -> Callable[[Task, Path, int], Scores]:
    def run(task: Task, _folder: Path, _seed: int) -> Scores:
        classifier = Classifier(load_bundle(name))
        return np.array([_person_by(classifier, each) for each in _test_dwells(task)])

    return run


def _test_dwells(task: Task) -> Iterator[Dwell]:
    for k in range(task.n_test // 2):
        # As `x2train.studies.thesis.sets` puts them: animal and person in turn.
        animal = task.cell.bodies[k % len(task.cell.bodies)]
        for body in (animal, "human"):
            yield dwell(task.spec, body, FRESH_FROM + k)[0]


def _person_by(classifier: Classifier, made: Dwell) -> float:
    bundle = classifier.bundle
    bundle.check_stream(made.axis, made.frame_rate_hz)
    settings = settings_at(bundle.features, made.frame_rate_hz)
    # The ring keeps every so many bins behind the matched filter; here they are left out.
    step = min(settings.range_decimation, max(1, int(COARSE_BIN_M / made.axis.bin_length_m)))
    rows = np.ascontiguousarray(made.frames[:, ::step])
    axis = replace(made.axis, n_range=rows.shape[1], bin_length_m=made.axis.bin_length_m * step)
    thin = replace(made, frames=rows, axis=axis, end_frame=len(rows))
    if settings.clutter == "removed":
        thin = ClutterRemover().remove(thin)
    p = classifier.classify(extract(thin, settings, classifier.feature_names))
    return p.human / max(p.human + p.pet, 1e-9)
