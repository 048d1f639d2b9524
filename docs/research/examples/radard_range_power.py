"""Mean power of what moves, in cells of range, in dB over the quietest cell."""

import numpy as np
from numpy.typing import NDArray

from radard.judge.features import FeatureSettings
from radard.stream.ring import Dwell


class RangePower:
    """One number for every cell of `FeatureSettings.n_range_cells`."""

    def shape(self, settings: FeatureSettings) -> tuple[int, ...]:
        """Return (n_range_cells,)."""
        return (settings.n_range_cells,)

    def extract(self, dwell: Dwell, settings: FeatureSettings) -> NDArray[np.float32]:
        """Return the cells; those outside the swath are zero."""
        rows = dwell.frames[dwell.valid]
        power = np.var(rows, axis=0)
        cell = ((dwell.axis.range_m - settings.near_m) / settings.cell_m).astype(int)
        cells = np.zeros(settings.n_range_cells)
        inside = (cell >= 0) & (cell < len(cells))
        np.maximum.at(cells, cell[inside], power[inside])
        live = cells > 0
        if live.any():
            cells[live] = 10 * np.log10(cells[live] / cells[live].min())
        return cells.astype(np.float32)


RANGE_POWER = RangePower()
