"""MATLAB files of our own: ``load FILE`` and ``scipy.io.loadmat`` give arrays and attributes.

Variables: samples (n, n_range) single, real or complex; counter (n, 1) uint32; t_s (n, 1)
double; the attributes of an HDF5 recording; device, settings and labels as JSON text (MATLAB's
``jsondecode``). Version 5, which every MATLAB reads and scipy, too; a variable of it holds 2 GiB
at most, ours 1 GiB with all the rest, because it is written and read as a whole.
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from x2radar.errors import SettingsError
from x2radar.recording.about import (
    NO_OVERRIDES,
    NUMBERS,
    SAMPLE_DTYPES,
    TEXTS,
    Overrides,
    kind_of,
    plain,
    read_about,
    root_attributes,
)
from x2radar.recording.blocks import BlockReader, Label, list_of
from x2radar.recording.faults import refuse
from x2radar.recording.formats.matlab import MAX_BYTES, variables

_ARRAYS = ("samples", "counter", "t_s")


class MatReader(BlockReader):
    """Read a MATLAB file with the variables that `write` makes; it is held as a whole."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        super().__init__(path, overrides)
        found = variables(path, {*_ARRAYS, *NUMBERS, *TEXTS, "labels"})
        if missing := sorted(set(_ARRAYS) - set(found)):
            raise refuse(path, f"lacks {', '.join(missing)}")
        self._rows = found["samples"]
        frames = kind_of(path, self._rows.shape, self._rows.dtype)
        self.n_frames = n = len(self._rows)
        self._counter = list_of(path, "counter", found["counter"], n)
        self._t_s = list_of(path, "t_s", found["t_s"], n)
        self._keep(read_about(path, frames, found, overrides, path.name))
        self._labels = plain(found.get("labels"))

    def read_labels(self) -> Iterable[Label]:
        """Return what the file says."""
        labels: list[Label] = json.loads(self._labels) if self._labels else []
        return labels


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new file; return what was not kept: nothing."""
    # Late: scipy takes a while, and all other formats do without.
    from scipy.io import savemat  # noqa: PLC0415

    axis = source.stream.axis
    dtype = np.dtype(SAMPLE_DTYPES[axis.kind])
    n_bytes = source.n_frames * axis.n_range * dtype.itemsize
    if n_bytes > MAX_BYTES * 3 // 4:
        msg = f"{path.name}: {n_bytes / 1e9:.1f} GB of samples are too many for a MATLAB file"
        raise SettingsError(msg)
    blocks = list(source.blocks())
    content: dict[str, Any] = {
        **root_attributes(source.stream, source.started_utc, source.device, source.settings),
        "samples": np.concatenate([block.samples for block in blocks]),
        "counter": np.concatenate([block.counter for block in blocks])[:, None],
        "t_s": np.concatenate([block.t_s for block in blocks])[:, None],
        "labels": json.dumps(source.labels),
    }
    savemat(path, content, appendmat=False)
    return []
