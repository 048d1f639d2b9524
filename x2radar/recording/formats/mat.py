"""MATLAB files of our own: ``load FILE`` and ``scipy.io.loadmat`` give arrays and attributes.

Variables: samples (n, n_range) single, real or complex; counter (n, 1) uint32; t_s (n, 1)
double; the attributes of an HDF5 recording; device, settings and labels as JSON text (MATLAB's
``jsondecode``). Version 5, which every MATLAB reads and scipy, too; a variable of it holds 2 GiB
at most, ours 1 GiB with all the rest, because it is written and read as a whole.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SettingsError
from x2radar.frame import Samples
from x2radar.recording.blocks import (
    MOST_BINS,
    NO_OVERRIDES,
    SAMPLE_DTYPES,
    BlockReader,
    Label,
    Overrides,
    as_samples,
    refuse,
)
from x2radar.recording.formats.axis import stream_from
from x2radar.recording.formats.mat5 import Mat5File
from x2radar.recording.hdf5_writer import root_attributes

MAGIC = b"MATLAB 5.0 MAT-file x2radar"
"""The text that such a file begins with; every program may write there what it likes."""
_TEXT_BYTES = 116
_MOST_BYTES = 1 << 30
"""As `mat5` reads."""
_NUMBERS = (
    *("frame_rate_hz", "carrier_hz", "sample_rate_hz", "bin_length_m", "range_offset_m"),
    *("bandwidth_hz", "phase_sign"),
)
_TEXTS = ("started_utc", "device", "settings", "labels", "run_id")
_ARRAYS = ("samples", "counter", "t_s")


class MatReader(BlockReader):
    """Read a MATLAB file that `write` has made; it is held as a whole."""

    def __init__(self, path: Path, overrides: Overrides = NO_OVERRIDES) -> None:
        self.path = path
        self._overrides = overrides
        found = Mat5File(path).variables((*_ARRAYS, *_NUMBERS, *_TEXTS))
        arrays = {n: v for n in _ARRAYS if isinstance(v := found.get(n), np.ndarray)}
        if set(arrays) != set(_ARRAYS):
            raise refuse(path, f"lacks {', '.join(sorted(set(_ARRAYS) - set(arrays)))}")
        samples = arrays["samples"]
        if samples.ndim != 2 or 0 in samples.shape or samples.shape[1] > MOST_BINS:
            raise refuse(path, f"samples have the shape {samples.shape}, not (n, n_range)")
        kind = "baseband" if samples.dtype.kind == "c" else "rf"
        self.n_frames = len(samples)
        if any(arrays[name].size != self.n_frames for name in ("counter", "t_s")):
            raise refuse(path, f"counter or t_s are no list of {self.n_frames} numbers")
        self._counter, self._t_s = arrays["counter"].ravel(), arrays["t_s"].ravel()
        said: dict[str, Any] = {
            n: v.item() for n in _NUMBERS if isinstance(v := found.get(n), np.ndarray)
        }
        self._texts = {n: v for n in _TEXTS if isinstance(v := found.get(n), str)}
        self._device, self._settings = self._json("device", {}), self._json("settings", {})
        name = str(self._device.get("name", path.name))
        about = {**said, "run_id": self._texts.get("run_id")}
        self.stream = stream_from(path, (kind, samples.shape[1]), about, overrides, name)
        self.started_utc = self._texts.get("started_utc", "")
        if kind == "baseband" and said.get("phase_sign", -1) > 0:
            samples = np.conj(samples)
        self._rows = as_samples(samples, kind)

    def read_labels(self) -> Iterable[Label]:
        """Return what the file says."""
        labels: list[Label] = self._json("labels", [])
        return labels

    def read_counters(self, first: int, last: int) -> NDArray[Any]:
        """See `BlockReader`."""
        return self._counter[first:last]

    def read_times(self, first: int, last: int) -> NDArray[np.float64]:
        """See `BlockReader`."""
        return self._t_s[first:last].astype(np.float64)

    def read_samples(self, first: int, last: int) -> Samples:
        """See `BlockReader`."""
        return self._rows[first:last]

    def _json(self, name: str, default: Any) -> Any:
        try:
            value = json.loads(self._texts.get(name) or "null")
        except ValueError:
            return default
        return value if isinstance(value, type(default)) else default


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new file; return what was not kept: nothing."""
    # Late: scipy takes a while, and all other formats do without.
    from scipy.io import savemat  # noqa: PLC0415

    axis = source.stream.axis
    dtype = np.dtype(SAMPLE_DTYPES[axis.kind])
    n_bytes = source.n_frames * axis.n_range * dtype.itemsize
    if n_bytes > _MOST_BYTES * 3 // 4:
        msg = f"{path.name}: {n_bytes / 1e9:.1f} GB of samples are too many for a MATLAB file"
        raise SettingsError(msg)
    blocks = list(source.blocks())
    about: Mapping[str, Any] = root_attributes(
        source.stream, source.started_utc, source.device, source.settings
    )
    content = {
        **about,
        "samples": np.concatenate([block.samples for block in blocks]),
        "counter": np.concatenate([block.counter for block in blocks])[:, None],
        "t_s": np.concatenate([block.t_s for block in blocks])[:, None],
        "labels": json.dumps(source.labels),
    }
    savemat(path, content, appendmat=False)
    with path.open("r+b") as file:
        file.write(MAGIC.ljust(_TEXT_BYTES))
    return []
