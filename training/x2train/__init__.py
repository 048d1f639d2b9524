"""Offline: simulate, train in torch, export to ONNX, and prove how good the result is."""

import radard as _radard  # before numpy: it limits the threads of matrix products

__all__: list[str] = []
del _radard
