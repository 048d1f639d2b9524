"""Who enters: the entries of this folder, a function of a file, or a bundle.

A bundle is not trained here: it judges each element as the first window of a stream, without
any before it, and says how much of p(human) + p(pet) is p(human).
"""

import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.detect.clutter_map import ClutterRemover
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.features import extract
from radard.stream.ring import Dwell
from research.benchmark import entries
from research.benchmark.tasks import Task
from x2train.judge.alarm_function import function_of, is_function, module_of
from x2train.thesis.elements import dwell
from x2train.thesis.recipe import FRESH_FROM

Scores = NDArray[np.float64]
Run = Callable[[Task, Path, int], Scores]


@dataclass(frozen=True, slots=True)
class Entrant:
    """One method."""

    name: str
    """For tables and file names."""
    title: str
    """For people."""
    run: Run
    """Takes the task, the folder of its data and a seed; returns p(person) of its test."""
    kept_as: str = ""
    """Its scores of earlier runs; empty where nobody knows that it is what it was."""


def shipped(function: str = "scores") -> tuple[str, ...]:
    """Return the names of the entries of this folder that have such a function."""
    names = [found.name for found in pkgutil.iter_modules(entries.__path__)]
    return tuple(n for n in names if hasattr(import_module(f"{entries.__name__}.{n}"), function))


def entrant_named(text: str) -> Entrant:
    """Return what ``NAME``, ``FILE.py[:FUNCTION]``, ``BUNDLE.onnx`` or a bundle's name means.

    Raises UsageError if it is none of them; BundleError and ModelMismatch are a bundle's.
    """
    if text in shipped():
        module = import_module(f"{entries.__name__}.{text}")
        run = _trained(module.scores, uses_vector=getattr(module, "USES_VECTOR", True))
        return Entrant(text, module.TITLE, run, kept_as=text)
    if is_function(text):
        return _of_file(text)
    bundle = load_bundle(text)
    title = f"bundle {bundle.name}, as it is"
    return Entrant(
        bundle.name, title, _judged_by(text), kept_as=f"{bundle.name}-{bundle.sha256[:12]}"
    )


def _trained(scores: Callable[..., Any], *, uses_vector: bool = True) -> Run:
    def run(task: Task, folder: Path, seed: int) -> Scores:
        test = task.test(folder)
        # What an entry must not see.
        hidden = replace(
            test, is_person=np.zeros(len(test), np.bool_), in_view=np.ones(len(test), np.float32)
        )
        train = task.train(folder)
        if not uses_vector:
            train = replace(train, vector=np.empty((len(train), 0), np.float32))
            hidden = replace(hidden, vector=np.empty((len(test), 0), np.float32))
        return np.asarray(scores(train, hidden, seed), np.float64)

    return run if uses_vector else _once(run)


def _once(run: Run) -> Run:
    """Return `run` for those who do not look at the thesis' vector.

    Tasks that differ in it alone are the same to them, and run once.
    """
    known: dict[tuple[Task, Path, int], Scores] = {}

    def once(task: Task, folder: Path, seed: int) -> Scores:
        frames = (replace(task, cell=replace(task.cell, vector=1)), folder, seed)
        if frames not in known:
            known[frames] = run(*frames)
        return known[frames]

    return once


def _of_file(text: str) -> Entrant:
    scores = function_of(text, "scores")
    path = Path(text.partition(":")[0])
    return Entrant(path.stem, title_of(text), _trained(scores))


def title_of(text: str) -> str:
    """Return what the file of ``FILE.py[:FUNCTION]`` calls its method: TITLE, else its name."""
    return str(getattr(module_of(text), "TITLE", Path(text.partition(":")[0]).stem))


def _judged_by(name: str) -> Run:
    def run(task: Task, _folder: Path, _seed: int) -> Scores:
        classifier = Classifier(load_bundle(name))
        return np.array([_person_by(classifier, each) for each in _test_dwells(task)])

    return _once(run)


def _test_dwells(task: Task) -> Iterator[Dwell]:
    for k in range(task.n_test // 2):
        # As `x2train.thesis.sets` puts them: animal and person in turn.
        animal = task.cell.bodies[k % len(task.cell.bodies)]
        for body in (animal, "human"):
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
    p = classifier.classify(extract(thin, settings, classifier.feature_names))
    return p.human / max(p.human + p.pet, 1e-9)
