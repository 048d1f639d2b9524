"""Raw frames into the thesis' network, without any features between (5.2.4).

An element's baseband frames, every 16th bin of them, which is about the pulse's width; real and
imaginary parts, scaled together to unit norm, as the vectors are.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2train.thesis.cells import Cell
from x2train.thesis.elements import ElementSpec, dwell
from x2train.thesis.fit import FitSettings, fit
from x2train.thesis.recipe import FRESH_FROM, StudyRecipe, Tell, last_of, with_stop
from x2train.thesis.results import CellResult, judged, seen
from x2train.thesis.sets import CellData

LABEL = "raw frames"
_DECIMATION = 16


@dataclass(frozen=True, slots=True)
class RawJob:
    """The thesis' network on the frames of one set."""

    recipe: StudyRecipe  # where results lie, and how many elements there are
    cell: Cell  # which set; its vector makes no difference
    fit: FitSettings

    @property
    def _settings(self) -> dict[str, Any]:
        recipe = self.recipe
        sizes = {"elements": recipe.n_elements, "fresh": recipe.n_fresh, "data_seed": recipe.seed}
        return {"fit": asdict(self.fit), "decimation": _DECIMATION, **sizes}

    def kept(self) -> CellResult | None:
        """Return the result of an earlier run."""
        return self.recipe.results.load(self.cell.name, LABEL, self._settings)

    def run(self, tell: Tell) -> CellResult:
        """Train, or return what was kept."""
        known = self.kept()
        if known is not None:
            return known
        recipe = self.recipe
        spec = recipe.spec(self.cell.frame_rate_hz)
        whole = raw_frames(spec, self.cell, 0, recipe.n_elements, tell)
        n_train = recipe.n_elements - recipe.n_evaluate
        train, stop, stopped_by = with_stop(whole.part(0, n_train))
        fitted = last_of(fit(train, stop, self.fit), self.cell, tell)
        evaluate = whole.part(n_train, recipe.n_elements)
        fresh = raw_frames(spec, self.cell, FRESH_FROM, recipe.n_fresh, tell)
        p = fitted.predict(fresh.x)
        result = CellResult(
            name=self.cell.name,
            label=LABEL,
            best=fitted.best_repeat,
            epochs=tuple(int(k) * self.fit.look_every for k in fitted.best_looks),
            evaluation=judged(fitted.predict(evaluate.x), evaluate.y),
            fresh=judged(p, fresh.y),
            in_view=seen(fresh, p),
            stopped_by=stopped_by,
            settings=self._settings,
        )
        recipe.results.save(result)
        return result


def raw_frames(spec: ElementSpec, cell: Cell, first: int, n: int, tell: Tell) -> CellData:
    """Return frames of `n` elements of a set, animal and person in turn, a row each."""
    rows: list[NDArray[np.float32]] = []
    in_view: list[float] = []
    for k in range(n // 2):
        for body in (cell.bodies[k % len(cell.bodies)], "human"):
            made, share = dwell(spec, body, first + k)
            bins = made.frames[:, ::_DECIMATION]
            row = np.concatenate([bins.real, bins.imag]).astype(np.float32).ravel()
            rows.append(row / max(float(np.linalg.norm(row)), 1e-30))
            in_view.append(share)
        tell(f"frames of {cell.name[2:]}", k + 1, n // 2)
    y = np.tile(np.array([0, 1], np.int64), n // 2)
    return CellData(np.stack(rows), y, np.array(in_view, np.float32))
