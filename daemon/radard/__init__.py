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

TYPE_CHECKING = False  # as typing has it, which takes longer to load than a signal should wait
# One thread for matrix products, set before numpy loads: the matrices here are small, and a
# second thread only burns another core while it waits for work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

if TYPE_CHECKING:
    from typing import Any

    from radard.api import FeatureWindow as FeatureWindow
    from radard.api import Spectrogram as Spectrogram
    from radard.api import classify as classify
    from radard.api import features as features
    from radard.api import spectrogram as spectrogram
    from radard.errors import RadardError as RadardError
    from radard.judge.bundle import Bundle as Bundle
    from radard.judge.bundle import bundle_names as bundle_names
    from radard.judge.bundle import load_bundle as load_bundle
    from radard.judge.classifier import Probabilities as Probabilities
    from radard.judge.decision import Decision as Decision
    from radard.judge.features import FEATURES as FEATURES
    from radard.judge.features import FeatureSettings as FeatureSettings

_PLACES = {
    "api": ("FeatureWindow", "Spectrogram", "classify", "features", "spectrogram"),
    "errors": ("RadardError",),
    "judge.bundle": ("Bundle", "bundle_names", "load_bundle"),
    "judge.classifier": ("Probabilities",),
    "judge.decision": ("Decision",),
    "judge.features": ("FEATURES", "FeatureSettings"),
}
"""The names that are offered here, by module."""
__all__ = sorted(name for names in _PLACES.values() for name in names)  # noqa: PLE0605 - below


def __getattr__(name: str) -> "Any":
    """Import what is asked for: the daemon itself needs none of it here."""
    for place, names in _PLACES.items():
        if name in names:
            return getattr(import_module(f"radard.{place}"), name)
    raise AttributeError(f"module 'radard' has no attribute '{name}'")
