"""Occlusion: which parts of the maps moved the verdict.

A part of a map is made dark, as if nothing moved there, and the network is asked again; what
that changes is what the part stood for. M. D. Zeiler and R. Fergus, "Visualizing and
Understanding Convolutional Networks", ECCV 2014, section 4.2.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.judge.bundle import Bundle, EvidenceSettings
from radard.judge.classifier import Answer, Classifier, Hidden, Probabilities
from radard.judge.decision import judge
from radard.judge.evidence import Evidence
from radard.judge.features import Features, FeatureSettings

_PATCHES = (8, 5)  # rows and columns: each is a limb's velocities for half a step
_MIN_P = 1e-4  # Log-odds of probabilities nearer to 0 or 1 say nothing more


@dataclass(frozen=True, slots=True)
class Seen:
    """Features that the network was given, and its answer."""

    features: Features
    hidden: Hidden | None
    answer: Answer


@dataclass(frozen=True, slots=True)
class MapView:
    """A map at `at` in the flat input `feature`, down columns or rows, with its axes."""

    name: str
    feature: str
    at: slice
    shape: tuple[int, int]
    is_by_column: bool
    rows: NDArray[np.float64]
    row_unit: str
    columns: NDArray[np.float64]
    column_unit: str

    def of(self, inputs: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the map, a view where the values lie by row."""
        flat = inputs.reshape(-1)[self.at]
        if self.is_by_column:
            return flat.reshape(self.shape[::-1]).T
        return flat.reshape(self.shape)


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
        whole = slice(0, values.size)
        if name in grids:
            grid = grids[name]
            n_rows = len(values)
            v = (np.arange(n_rows, dtype=np.float64) - n_rows // 2) * grid.step_mps
            yield _timed(name, values.shape, (v, "m/s"), grid.cell_s)
        elif name == "range_time":
            is_fixed = settings.range_window == "fixed"
            near_m = settings.near_m if is_fixed else 0.0
            r = near_m + np.arange(len(values), dtype=np.float64) * settings.cell_m
            unit = "m" if is_fixed else "m into the window"
            yield _timed(name, values.shape, (r, unit), settings.cell_s)
        elif name.startswith("thesis_type"):
            yield from _thesis_views(name, settings, values.size)
        elif values.ndim == 2:
            axes = (np.arange(n, dtype=np.float64) for n in values.shape)
            yield MapView(
                name, name, whole, values.shape, False, next(axes), "row", next(axes), "column"
            )


def _timed(
    name: str, shape: tuple[int, ...], axis: tuple[NDArray[np.float64], str], cell_s: float
) -> MapView:
    n_rows, n_columns = shape
    ends_s = (np.arange(n_columns, dtype=np.float64) + 1 - n_columns) * cell_s
    whole = slice(0, n_rows * n_columns)
    return MapView(name, name, whole, (n_rows, n_columns), False, *axis, ends_s, "s")


def _thesis_views(name: str, settings: FeatureSettings, size: int) -> Iterator[MapView]:
    m, n_cadence = settings.n_cpi, settings.n_cadence
    n_profile = size - m * n_cadence
    if n_profile:
        row = np.zeros(1, np.float64)
        bins = np.arange(n_profile, dtype=np.float64)
        at = slice(0, n_profile)
        yield MapView("range profile", name, at, (1, n_profile), False, row, "", bins, "bin")
    doppler = np.arange(m, dtype=np.float64) - m // 2
    cadence = np.arange(n_cadence, dtype=np.float64) / settings.dwell_s
    at = slice(n_profile, size)
    shape = (m, n_cadence)
    yield MapView("cadence-velocity", name, at, shape, True, doppler, "Doppler bin", cadence, "Hz")


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


def effects(parts: list[Part], view: MapView) -> NDArray[np.float64]:
    """Return the effect of every cell of a map, shape (n_rows, n_columns), float64."""
    out = np.zeros(view.shape)
    for part in parts:
        if part.view.name == view.name:
            out[part.rows, part.columns] = part.effect
    return out


def _patches(shape: tuple[int, int]) -> Iterator[tuple[slice, slice]]:
    edges = [
        np.linspace(0, n, min(n, most) + 1).round().astype(int).tolist()
        for n, most in zip(shape, _PATCHES, strict=True)
    ]
    for top, bottom in zip(edges[0], edges[0][1:], strict=False):
        for left, right in zip(edges[1], edges[1][1:], strict=False):
            yield slice(top, bottom), slice(left, right)


def _log_odds(p: float) -> float:
    p = min(max(p, _MIN_P), 1 - _MIN_P)
    return float(np.log(p / (1 - p)))


def _judged_by(answer: Answer, bundle: Bundle) -> Probabilities:
    """Return the probabilities that the rule takes: a temporal head's, or this window's."""
    if answer.fused_log_p is None:
        return answer.window
    return Evidence(EvidenceSettings.from_mapping(bundle.evidence)).fuse(answer)
