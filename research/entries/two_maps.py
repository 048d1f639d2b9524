"""The project's features: the spectrogram and the range-time map, a small network on both.

Source: `x2train.thesis.own`; the shipped bundles see more and longer maps, and windows
before this one.
"""

import numpy as np
from numpy.typing import NDArray

from benchmark_tasks import Elements
from x2train.thesis.own import OwnSettings, predict_maps, train_maps

TITLE = "this project's maps"
USES_VECTOR = False


def scores(train: Elements, test: Elements, seed: int) -> NDArray[np.float64]:
    """Return the probability of a person for every element of `test`."""

    def maps(elements: Elements) -> dict[str, NDArray[np.float32]]:
        return {"mu": elements.mu, "range_time": elements.range_time}

    y = train.is_person.astype(np.int64)
    net = train_maps(maps(train), y, OwnSettings(seed=seed))
    return predict_maps(net, maps(test))[:, 1]
