"""What moves: features of a dwell, the network of a bundle, evidence over windows, the decision.

It may import `radard.detect` and below. The package can be called: `radard.classify(frames, axis,
frame_rate_hz)` judges frames in an array, see `radard.api.classify`.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any


class _Callable(ModuleType):
    """The package, which shares its name with the function at the top of `radard`."""

    def __call__(self, *args: Any, **options: Any) -> Any:
        """See `radard.api.classify`."""
        # Late, and by name: the function lies above this package.
        return import_module("radard.api").classify(*args, **options)


sys.modules[__name__].__class__ = _Callable
