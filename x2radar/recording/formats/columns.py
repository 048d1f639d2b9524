"""What formats of real columns share: samples without complex numbers, and what goes beside."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.frame import Samples
from x2radar.recording.about import root_attributes
from x2radar.recording.blocks import BlockReader


def real_columns(samples: Samples) -> dict[str, NDArray[np.float32]]:
    """Return samples, shape (n, n_range), as contiguous float32 by the name of their column."""
    is_rf = samples.dtype.kind != "c"
    parts = (samples,) if is_rf else (samples.real, samples.imag)
    names = column_names("rf" if is_rf else "baseband")
    return dict(zip(names, (np.ascontiguousarray(p, np.float32) for p in parts), strict=True))


def column_names(kind: str) -> tuple[str, ...]:
    """Return the names that `real_columns` gives to frames of a kind."""
    return ("samples",) if kind == "rf" else ("samples_i", "samples_q")


def described(source: BlockReader) -> dict[str, Any]:
    """Return the attributes of an HDF5 recording, with n_range, and its labels."""
    about = root_attributes(source.stream, source.started_utc, source.device, source.settings)
    labels = [list(label) for label in source.labels]
    settings = {"device": dict(source.device), "settings": dict(source.settings)}
    return {**about, "n_range": source.stream.axis.n_range, **settings, "labels": labels}
