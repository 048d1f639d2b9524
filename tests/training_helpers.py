"""Small sets and networks that several tests of the training share."""

import numpy as np

from radard.classifier import ModelInput
from radard.features import feature_shape
from x2train.commands.dataset import FEATURES
from x2train.map_fit import INPUTS as MAPS
from x2train.map_fit import MapFitSettings, MapTrained, fit_maps

TINY = MapFitSettings(
    epochs=20,
    batch=16,
    widths=(4, 6, 6, 6),
    long_widths=(4, 6, 6, 6),
    hidden=8,
    learning_rate=1e-2,
)
INPUTS = tuple(ModelInput(name, feature_shape(name, FEATURES), name) for name in MAPS)


def toy(n=96, seed=0):
    """Return windows of three classes that a glance tells apart, four to a passage."""
    rng = np.random.default_rng(seed)
    label = np.arange(n) // 4 % 3
    maps = {
        name: rng.integers(0, 60, (n, *feature_shape(name, FEATURES)), np.uint8) for name in MAPS
    }
    for k, at in enumerate(label):
        maps["velocity_time"][k, 10 + 30 * at : 24 + 30 * at] = 220
        maps["range_time"][k, 30:34] = 200
    return {
        **maps,
        "label": label.astype(np.int64),
        "passage": np.arange(n) // 4,
        "t_s": 3.0 + np.arange(n) % 4,
    }


def trained(settings=TINY, *, n=96):
    """Return a network that knows the toy windows, and its epochs."""
    *epochs, made = fit_maps(toy(n), toy(48, seed=1), settings)
    assert isinstance(made, MapTrained)
    return made, epochs


__all__ = ["FEATURES", "INPUTS", "MAPS", "TINY", "toy", "trained"]
