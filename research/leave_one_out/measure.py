"""Networks that never saw one law, and how well they tell people from pets under it.

The figure is the window AUC of people against pets that go and are in view: a network that knows
its simulator by heart falls on the law that it has not seen. One passage in four is kept from all
trainings.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from x2radar.sim.bodies.motion.curves import MOTIONS
from x2radar.sim.bodies.skin.draw import SKINS
from x2train.nets.epoch import Epoch
from x2train.nets.map_fit import MapFitSettings, MapTrained, fit_maps, logits_of
from x2train.report.ranking import Ranking
from x2train.sets.window_set import Columns

_KEPT, _A_ROUND = 4, 5  # one in so many rounds is judged on alone: chosen; labels come in rounds
_LEAST_SHARE, _LEAST_MPS = 0.7, 0.12  # of the window in view, and mean speed: chosen
_LAWS: Mapping[str, tuple[str, ...]] = {"motion": MOTIONS, "skin": tuple(SKINS)}


@dataclass(frozen=True, slots=True)
class Law:
    """A motion or a skin."""

    kind: str
    name: str

    def __str__(self) -> str:
        return f"{self.kind} {self.name}"

    def of(self, windows: Columns) -> NDArray[np.bool_]:
        """Return which windows of people and pets it made, shape (n,)."""
        is_this = windows[self.kind] == _LAWS[self.kind].index(self.name)
        return np.asarray(is_this & (windows["label"] < 2))


def laws_of(windows: Columns) -> tuple[Law, ...]:
    """Return the laws that windows were made by; UsageError if there is one of each alone."""
    found = tuple(
        Law(kind, name)
        for kind, names in _LAWS.items()
        for k, name in enumerate(names)
        if kind in windows and (windows[kind] == k).any()
    )
    if len(found) <= len(_LAWS):
        msg = "the sets hold one motion and one skin: make one with --motion and --skin"
        raise UsageError(msg)
    return found


def trained(
    windows: Columns, left_out: Law | None, epochs: int, seed: int
) -> Iterator[Epoch | MapTrained]:
    """Train a network without a law; yields as `fit_maps`."""
    is_kept = _is_kept(windows)
    use = ~is_kept if left_out is None else ~is_kept & ~left_out.of(windows)
    train, judged = _rows(windows, use), _rows(windows, is_kept)
    return fit_maps(train, judged, MapFitSettings(epochs=epochs, seed=seed))


def auc_on(made: MapTrained, windows: Columns, law: Law) -> float | None:
    """Return the AUC of people against pets on the kept windows of a law, to four digits.

    None if there are not both of them.
    """
    clear = (windows["share"] > _LEAST_SHARE) & (windows["speed_mps"] > _LEAST_MPS)
    rows = _rows(windows, law.of(windows) & clear & _is_kept(windows))
    logits = logits_of(made.net, rows)
    others = np.logaddexp(logits[:, 1], logits[:, 2])
    ranking = Ranking(logits[:, 0] - others, np.asarray(rows["label"] == 0))
    auc = ranking.auc()
    return None if np.isnan(auc) else round(auc, 4)


def _is_kept(windows: Columns) -> NDArray[np.bool_]:
    """Return which windows no training sees, of all labels evenly, shape (n,)."""
    return np.asarray(windows["passage"] // _A_ROUND % _KEPT == 0)


def _rows(windows: Columns, use: NDArray[np.bool_]) -> Mapping[str, NDArray[Any]]:
    return {key: column[use] for key, column in windows.items()}
