"""Occlusion: which parts of the maps moved the verdict (Zeiler and Fergus, ECCV 2014, 4.2).

A part of a map is made dark, and the network is asked again: what changes is what it stood for.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from radard.judge.bundle import Bundle, EvidenceSettings
from radard.judge.classifier import Answer, Classifier, Probabilities, Seen
from radard.judge.decision import judge
from radard.judge.evidence import Evidence
from radard.judge.features import FeatureSettings

_PATCHES = (8, 5)  # rows and columns: each is a limb's velocities for half a step
_MIN_P = 1e-4  # Log-odds of probabilities nearer to 0 or 1 say nothing more


@dataclass(frozen=True, slots=True)
class MapView:
    """A map at `at` in the flat input `feature`, with its axes."""

    name: str
    feature: str
    at: slice
    shape: tuple[int, int]
    order: Literal["C", "F"]  # by rows or down columns
    rows: NDArray[np.float64]
    row_unit: str
    columns: NDArray[np.float64]
    column_unit: str

    def of(self, inputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the map, a view of the input."""
        return inputs.reshape(-1)[self.at].reshape(self.shape, order=self.order)


@dataclass(frozen=True, slots=True)
class Part:
    """What one part of a map stood for: `p_human` with it dark, `effect` its log-odds, in nats."""

    view: MapView
    rows: slice
    columns: slice
    p_human: float
    effect: float
    turns: bool


def map_views(settings: FeatureSettings, seen: Seen) -> Iterator[MapView]:
    """Yield the maps among the inputs of a network; a plug-in's feature has bins for axes."""
    grids = settings.velocity_grids()
    for name, values in seen.features.items():
        if name.startswith("thesis_type"):
            yield from _thesis_views(name, settings, values.size)
        if values.ndim != 2:
            continue
        rows, columns = (np.arange(n, dtype=np.float64) for n in values.shape)
        row_unit, column_unit, cell_s = "row", "column", 0.0
        if name in grids:
            rows = (rows - len(rows) // 2) * grids[name].step_mps
            row_unit, cell_s = "m/s", grids[name].cell_s
        elif name == "range_time":
            is_fixed = settings.range_window == "fixed"
            rows = (settings.near_m if is_fixed else 0.0) + rows * settings.cell_m
            row_unit, cell_s = "m" if is_fixed else "m into the window", settings.cell_s
        if cell_s:
            columns, column_unit = (columns + 1 - len(columns)) * cell_s, "s"
        at = slice(0, values.size)
        yield MapView(name, name, at, values.shape, "C", rows, row_unit, columns, column_unit)


def _thesis_views(name: str, settings: FeatureSettings, size: int) -> Iterator[MapView]:
    m, n_cadence = settings.n_cpi, settings.n_cadence
    n_profile = size - m * n_cadence
    if n_profile:
        row, bins = np.zeros(1, np.float64), np.arange(n_profile, dtype=np.float64)
        at = slice(0, n_profile)
        yield MapView("range profile", name, at, (1, n_profile), "C", row, "", bins, "bin")
    doppler = np.arange(m, dtype=np.float64) - m // 2
    cadence = np.arange(n_cadence, dtype=np.float64) / settings.dwell_s
    at, shape = slice(n_profile, size), (m, n_cadence)
    yield MapView("cadence-velocity", name, at, shape, "F", doppler, "Doppler bin", cadence, "Hz")


def occluded(
    classifier: Classifier, settings: FeatureSettings, seen: Seen, pet_limit: float
) -> list[Part]:
    """Return every part of every map, with what it stood for, the strongest first."""
    as_it_was = _judged_by(seen.answer, classifier.bundle)
    _, alarm = judge(as_it_was, pet_limit)
    parts = []
    for view in map_views(settings, seen):
        for rows, columns in _patches(view.shape):
            values = seen.features[view.feature].copy()
            view.of(values)[rows, columns] = 0.0
            features = {**seen.features, view.feature: values}
            p = _judged_by(classifier.answer(features, seen.hidden), classifier.bundle)
            effect = _log_odds(as_it_was.human) - _log_odds(p.human)
            turns = judge(p, pet_limit)[1] != alarm
            parts.append(Part(view, rows, columns, p.human, effect, turns))
    return sorted(parts, key=lambda part: -abs(part.effect))


def effects(parts: Sequence[Part], view: MapView) -> NDArray[np.float64]:
    """Return the effect of every cell of a map, shape (n_rows, n_columns), float64."""
    out = np.zeros(view.shape)
    for part in parts:
        if part.view.name == view.name:
            out[part.rows, part.columns] = part.effect
    return out


def _patches(shape: tuple[int, int]) -> Iterator[tuple[slice, slice]]:
    rows, columns = (
        np.linspace(0, n, min(n, most) + 1).round().astype(int).tolist()
        for n, most in zip(shape, _PATCHES, strict=True)
    )
    for row, column in product(pairwise(rows), pairwise(columns)):
        yield slice(*row), slice(*column)


def _log_odds(p: float) -> float:
    p = min(max(p, _MIN_P), 1 - _MIN_P)
    return float(np.log(p / (1 - p)))


def _judged_by(answer: Answer, bundle: Bundle) -> Probabilities:
    """Return the probabilities that the rule takes: a temporal head's, or this window's."""
    if answer.fused_log_p is None:
        return answer.window
    return Evidence(EvidenceSettings.from_mapping(bundle.evidence)).fuse(answer)
