"""Pet-immune radar alarm: the service. Read `radard.pipeline` first.

For scripts and notebooks, `radard.api` has what is offered here:

>>> import radard, x2radar
>>> frames, stream = x2radar.simulate("dog", duration_s=3, seed=1)
>>> decision, = radard.classify(frames, stream.axis, stream.frame_rate_hz)
>>> decision.label, decision.alarm
('pet', False)
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

# One thread for matrix products, set before numpy loads: the matrices here are small, and a
# second thread only burns another core while it waits for work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

if TYPE_CHECKING:
    from radard.api import FeatureWindow, Spectrogram, classify, features, spectrogram
    from radard.errors import RadardError
    from radard.judge.bundle import Bundle, bundle_names, load_bundle
    from radard.judge.classifier import Probabilities
    from radard.judge.decision import Decision
    from radard.judge.features import FEATURES, FeatureSettings

_PLACES = {
    "FEATURES": "judge.features",
    "Bundle": "judge.bundle",
    "Decision": "judge.decision",
    "FeatureSettings": "judge.features",
    "FeatureWindow": "api",
    "Probabilities": "judge.classifier",
    "RadardError": "errors",
    "Spectrogram": "api",
    "bundle_names": "judge.bundle",
    "classify": "api",
    "features": "api",
    "load_bundle": "judge.bundle",
    "spectrogram": "api",
}
"""Where the names of `__all__` are."""
__all__ = [
    "FEATURES",
    "Bundle",
    "Decision",
    "FeatureSettings",
    "FeatureWindow",
    "Probabilities",
    "RadardError",
    "Spectrogram",
    "bundle_names",
    "classify",
    "features",
    "load_bundle",
    "spectrogram",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for: the daemon itself needs none of it here."""
    if name not in _PLACES:
        msg = f"module 'radard' has no attribute '{name}'"
        raise AttributeError(msg)
    return getattr(import_module(f"radard.{_PLACES[name]}"), name)
