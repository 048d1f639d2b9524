"""Calibration: noise floor and threshold of every range bin, kept in a JSON file.

Made in an empty room, it replaces what the gate learns from the stream. The file::

    {"format": "radard-calibration", "format_version": 2, "frame_rate_hz": 60.0,
     "bin_length_m": 0.02925, "range_offset_m": 0.6,
     "noise_floor_db": [one per bin], "threshold_db": [one per bin],
     "provenance": {"made_utc": ..., "device": ..., "software": ..., ...}}

Floors are 10 log10 of power in sample units squared, null where a bin is dead; thresholds
are dB over the floor. The provenance, which may be missing, says where all this is from.
"""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field

from radard.config.json_file import LOOSE, STRICT, parse_json
from radard.errors import ConfigError
from x2radar.atomic import write_whole
from x2radar.frame import FastTimeAxis

_RESTLESS_DB = 6.0  # as a survey calls a bin restless
_CELL_M = 0.1  # to which spans are rounded, for people
_MIN_M = 0.3  # of a span: a machine is as large
_MAX_AGE_D = 90.0  # older ones are called stale: rooms and receivers change with the seasons


def _moment(text: str) -> str:
    if text and datetime.fromisoformat(text).tzinfo is None:
        raise ValueError("no time zone")
    return text


# Beyond any carrier and any power in decibels: a whole number of JSON has no end.
_Number = Annotated[float, Field(ge=-1e15, le=1e15)]
_Decibels = Annotated[float, Field(ge=-1000, le=1000)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Where a calibration is from; empty texts and zeros where that is not known."""

    __pydantic_config__ = STRICT

    made_utc: Annotated[str, AfterValidator(_moment)] = ""  # ISO 8601
    device: str = ""  # what sent the frames, as `StreamInfo.device` has it
    port: str = ""  # without secrets
    software: str = ""  # version of radard
    model: str = ""  # whose range bins and CPI these are
    carrier_hz: _Number = 0.0
    duration_s: _Number = 0.0  # stream time that was listened to
    n_dwells: int = 0  # dwells in it
    false_gates_per_day: _Number = 0.0  # predicted: decisions that open the gate in such a room


@dataclass(frozen=True, slots=True, kw_only=True)
class _CalibrationFile:
    __pydantic_config__ = LOOSE

    format: Literal["radard-calibration"]
    format_version: Literal[2]
    frame_rate_hz: _Number
    bin_length_m: _Number
    range_offset_m: _Number
    noise_floor_db: Annotated[tuple[_Decibels | None, ...], Field(min_length=1)]
    threshold_db: tuple[Annotated[float, Field(ge=0, le=120)], ...]
    provenance: Provenance = Provenance()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """What an empty room looks like, behind down-conversion and range decimation."""

    frame_rate_hz: float
    bin_length_m: float
    range_offset_m: float
    floor: NDArray[np.float64]  # noise power of every bin, sample units squared; 0: dead
    threshold_db: NDArray[np.float64]  # how far over its floor a bin's residual power must stand
    provenance: Provenance = Provenance()

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
                raise ConfigError(f"calibration: {name} is {own:g}, the stream's is {stream:g}")

    def stale(self, *, device: str, software: str, now: datetime) -> Iterator[str]:
        """Yield, in a few words each, why this should be made again; nothing if it is fresh."""
        made = self.provenance
        if made.made_utc:
            age_d = (now - datetime.fromisoformat(made.made_utc)).total_seconds() / 86_400
            if age_d > _MAX_AGE_D:
                yield f"it is {age_d:.0f} days old"
            elif age_d < -1:
                yield f"it is from the future ({made.made_utc}): is the clock right?"
        pairs = (("device", made.device, device), ("version", made.software, software))
        for name, own, other in pairs:
            if own and other and own != other:
                yield f"it was made with {name} '{own}', this is '{other}'"

    def text(self) -> str:
        """Return the content of the file; floors keep 0.001 dB."""
        with np.errstate(divide="ignore"):
            floor_db = 10 * np.log10(self.floor)
        content = {
            "format": "radard-calibration",
            "format_version": 2,
            "frame_rate_hz": self.frame_rate_hz,
            "bin_length_m": self.bin_length_m,
            "range_offset_m": self.range_offset_m,
            "noise_floor_db": [round(v, 3) if np.isfinite(v) else None for v in floor_db.tolist()],
            "threshold_db": [round(v, 3) for v in self.threshold_db.tolist()],
            "provenance": asdict(self.provenance),
        }
        return json.dumps(content) + "\n"

    def save(self, path: Path) -> None:
        """Write the file, for all users to read; raises OSError if that fails."""
        write_whole(path, self.text())


def restless_spans(calibration: Calibration) -> list[tuple[float, float]]:
    """Return the ranges, [from, to] in metres, where something moved in the empty room."""
    with np.errstate(divide="ignore"):
        needed_db = 10 * np.log10(calibration.floor) + calibration.threshold_db
    live = np.isfinite(needed_db)
    if not live.any():
        return []
    is_restless = live & (needed_db > np.median(needed_db[live]) + _RESTLESS_DB)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_restless.astype(int), [0]])))
    start_m, bin_m = calibration.range_offset_m, calibration.bin_length_m
    spans: list[tuple[float, float]] = []
    for first, end in edges.reshape(-1, 2):
        low_m = np.floor((start_m + first * bin_m) / _CELL_M + 1e-6) * _CELL_M
        high_m = np.ceil((start_m + end * bin_m) / _CELL_M - 1e-6) * _CELL_M
        if spans and low_m <= spans[-1][1] + _MIN_M:
            low_m = spans.pop()[0]
        spans.append((round(max(low_m, 0.0), 2), round(high_m, 2)))
    return [span for span in spans if span[1] - span[0] >= _MIN_M - 1e-9]


def load_calibration(path: Path) -> Calibration:
    """Read a calibration file; ConfigError, naming file and key, if it cannot be used."""
    try:
        made = parse_json(_CalibrationFile, path.read_bytes())
    except OSError as err:
        raise ConfigError(f"{path}: cannot read the calibration: {err.strerror}") from err
    except ValueError as err:
        msg = f"{path}: not a calibration that is read here: {err}; calibrate again"
        raise ConfigError(msg) from err
    n, n_bins = len(made.threshold_db), len(made.noise_floor_db)
    if n != n_bins:
        raise ConfigError(f"{path}: threshold_db: {n} values for {n_bins} bins")
    floor_db = np.array([-np.inf if v is None else v for v in made.noise_floor_db])
    return Calibration(
        frame_rate_hz=made.frame_rate_hz,
        bin_length_m=made.bin_length_m,
        range_offset_m=made.range_offset_m,
        floor=10 ** (floor_db / 10),
        threshold_db=np.array(made.threshold_db),
        provenance=made.provenance,
    )
