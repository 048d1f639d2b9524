"""Calibration: noise floor and threshold of every range bin, kept in a JSON file.

Made in an empty room, it takes the place of what the gate learns from the stream. The file::

    {"format": "radard-calibration", "format_version": 1, "frame_rate_hz": 60.0,
     "bin_length_m": 0.02925, "range_offset_m": 0.6,
     "noise_floor_db": [one per bin], "threshold_db": [one per bin]}

Floors are 10 log10 of power in sample units squared, null where a bin is dead; thresholds
are dB over the floor.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.errors import ConfigError
from x2radar.frame import FastTimeAxis

FORMAT = "radard-calibration"
VERSION = 1
_NUMBERS = ("frame_rate_hz", "bin_length_m", "range_offset_m")
_LISTS = ("noise_floor_db", "threshold_db")
_MOST_DB = 120.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """What an empty room looks like.

    Attributes
    ----------
    frame_rate_hz, bin_length_m, range_offset_m : float
        Stream that it was made with, behind down-conversion and range decimation.
    floor : ndarray, shape (n_range,), float64
        Noise power of every bin in sample units squared; 0 where a bin is dead.
    threshold_db : ndarray, shape (n_range,), float64
        How far over its floor a bin's residual power must stand, in dB.
    """

    frame_rate_hz: float
    bin_length_m: float
    range_offset_m: float
    floor: NDArray[np.float64]
    threshold_db: NDArray[np.float64]

    def check(self, axis: FastTimeAxis, frame_rate_hz: float) -> None:
        """Raise ConfigError, naming the value, unless the calibration fits a stream."""
        pairs = (
            ("frame_rate_hz", self.frame_rate_hz, frame_rate_hz, 0.01 * frame_rate_hz),
            ("bin_length_m", self.bin_length_m, axis.bin_length_m, 1e-3 * axis.bin_length_m),
            ("range_offset_m", self.range_offset_m, axis.range_offset_m, axis.bin_length_m),
            ("number of bins", len(self.floor), axis.n_range, 0.0),
        )
        for name, own, stream, slack in pairs:
            if abs(own - stream) > slack:
                msg = f"calibration: {name} is {own:g}, the stream's is {stream:g}"
                raise ConfigError(msg)

    def save(self, path: Path) -> None:
        """Write the file; floors keep 0.001 dB."""
        with np.errstate(divide="ignore"):
            floor_db = 10 * np.log10(self.floor)
        content = {
            "format": FORMAT,
            "format_version": VERSION,
            **{name: getattr(self, name) for name in _NUMBERS},
            "noise_floor_db": [round(v, 3) if np.isfinite(v) else None for v in floor_db.tolist()],
            "threshold_db": [round(v, 3) for v in self.threshold_db.tolist()],
        }
        path.write_text(json.dumps(content) + "\n", encoding="utf-8")


def load_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Parameters
    ----------
    path : Path
        Written by `Calibration.save`.

    Returns
    -------
    Calibration
        Its values checked, not yet its fit to a stream (`Calibration.check`).

    Raises
    ------
    ConfigError
        If it cannot be read or a value makes no sense; names file and key.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as err:
        msg = f"{path}: cannot read the calibration ({err})"
        raise ConfigError(msg) from err
    if not isinstance(raw, dict) or raw.get("format") != FORMAT:
        msg = f"{path}: not a calibration: format is not '{FORMAT}'"
        raise ConfigError(msg)
    if raw.get("format_version") != VERSION:
        msg = f"{path}: format_version {raw.get('format_version')!r} is not {VERSION}"
        raise ConfigError(msg)
    numbers = {name: _number(path, name, raw.get(name)) for name in _NUMBERS}
    floor_db, threshold_db = (_list(path, name, raw.get(name)) for name in _LISTS)
    if len(floor_db) != len(threshold_db):
        msg = f"{path}: threshold_db: {len(threshold_db)} values for {len(floor_db)} bins"
        raise ConfigError(msg)
    if not ((threshold_db >= 0) & (threshold_db <= _MOST_DB)).all():
        msg = f"{path}: threshold_db: values must be 0 to {_MOST_DB:g}"
        raise ConfigError(msg)
    return Calibration(floor=10 ** (floor_db / 10), threshold_db=threshold_db, **numbers)


def _number(path: Path, name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        msg = f"{path}: {name}: {value!r} is not a number"
        raise ConfigError(msg)
    return float(value)


def _list(path: Path, name: str, value: Any) -> NDArray[np.float64]:
    if not isinstance(value, list) or not value:
        msg = f"{path}: {name}: must be a list with a number for every bin"
        raise ConfigError(msg)
    dead = -np.inf if name == "noise_floor_db" else None
    return np.array(
        [dead if v is None and dead is not None else _number(path, name, v) for v in value]
    )
