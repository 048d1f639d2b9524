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
from x2train.thesis.recipe import FRESH_FROM, KeptJob, Tell, last_of, with_stop
from x2train.thesis.results import CellResult
from x2train.thesis.sets import CellData

LABEL = "raw frames"
_DECIMATION = 16


@dataclass(frozen=True, slots=True, eq=False)
class RawJob(KeptJob):
    """The thesis' network on the frames of one set, whatever its vector."""

    fit: FitSettings

    @property
    def _key(self) -> tuple[str, str, dict[str, Any]]:
        recipe = self.recipe
        sizes = {"elements": recipe.n_elements, "fresh": recipe.n_fresh, "data_seed": recipe.seed}
        settings = {"fit": asdict(self.fit), "decimation": _DECIMATION, **sizes}
        return self.cell.name, LABEL, settings

    def _train(self, tell: Tell) -> CellResult:
        recipe = self.recipe
        spec = recipe.spec(self.cell.frame_rate_hz)
        whole = raw_frames(spec, self.cell, 0, recipe.n_elements, tell)
        n_train = recipe.n_elements - recipe.n_evaluate
        train, stop, stopped_by = with_stop(whole.part(0, n_train))
        fitted = last_of(fit(train, stop, self.fit), self.cell, tell)
        evaluate = whole.part(n_train, recipe.n_elements)
        fresh = raw_frames(spec, self.cell, FRESH_FROM, recipe.n_fresh, tell)
        return self._reached(fitted, self.fit.look_every, evaluate, fresh, stopped_by=stopped_by)


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
