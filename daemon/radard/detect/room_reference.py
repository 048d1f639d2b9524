"""RoomReference: what tamper is measured against, kept over a restart in one small JSON file.

Without it, somebody who covers or jams the sensor and then restarts radard, or its machine,
would have made that the room. A file that cannot be read, or is of another stream, counts as none.
"""

import json
import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from radard.config.json_file import STRICT, parse_json
from radard.detect.interference import FloorReference
from x2radar.atomic import write_atomically

log = logging.getLogger("radard")
_MAX_BYTES = 1_000_000  # 200 times what an X2's takes


@dataclass(frozen=True, slots=True, eq=False)
class RoomReference:
    """Still echoes, noise and floors of a room; powers in sample units squared."""

    echoes: NDArray[np.complex128]  # learned of every cell, shape (n_cells, n_bins); empty: none
    usable: NDArray[np.bool_]  # cells that can be judged, shape (n_cells,)
    noise_db: float | None  # receiver's noise, as it was learned and as it has drifted since
    noise_kept_db: float | None
    floor: FloorReference


_Powers = tuple[Annotated[float, Field(gt=0)] | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _RoomFile:
    """What the file holds, key by key; a power that is null is infinite."""

    __pydantic_config__ = STRICT

    format: Literal["radard-room"]
    format_version: Literal[1]
    stream: str
    echoes: tuple[tuple[tuple[float, float], ...], ...]
    usable: tuple[bool, ...]
    noise_db: float | None
    noise_kept_db: float | None
    floor: _Powers
    floor_kept: _Powers
    calm_s: Annotated[float, Field(ge=0)]


@dataclass(slots=True)
class RoomStore:
    """Keep one reference in a file, for one `stream` alone; without a path, nothing."""

    path: Path | None = None
    stream: str = ""
    _has_failed: bool = field(default=False, init=False)

    def load(self) -> RoomReference | None:
        """Return what was kept of this stream; None without it."""
        if self.path is None:
            return None
        try:
            with self.path.open("rb") as file:
                made = parse_json(_RoomFile, file.read(_MAX_BYTES))
            if made.stream != self.stream:
                log.info("%s: of another stream or calibration, and not used", self.path)
                return None
            return _parsed(made)
        except FileNotFoundError:
            return None
        except (OSError, ValueError) as err:
            log.warning("%s: the room's reference is unreadable and not used (%s)", self.path, err)
            return None

    def save(self, room: RoomReference) -> None:
        """Keep a reference; a failure is logged once, and tried again the next time."""
        if self.path is None:
            return
        content = {
            "format": "radard-room",
            "format_version": 1,
            "stream": self.stream,
            "echoes": [[[z.real, z.imag] for z in row] for row in room.echoes.tolist()],
            "usable": room.usable.tolist(),
            "noise_db": room.noise_db,
            "noise_kept_db": room.noise_kept_db,
            "floor": _finite(room.floor.first),
            "floor_kept": _finite(room.floor.kept),
            "calm_s": room.floor.t_s,
        }
        try:
            write_atomically(self.path, json.dumps(content) + "\n", mode=0o600)
        except OSError as err:
            if not self._has_failed:
                log.warning("%s: cannot keep the room's reference: %s", self.path, err.strerror)
            self._has_failed = True
        else:
            self._has_failed = False

    def forget(self, stream: str) -> None:
        """Remove what was kept; what will be kept is of `stream`."""
        self.stream = stream
        if self.path is None:
            return
        try:
            self.path.unlink(missing_ok=True)
        except OSError as err:
            log.warning("%s: cannot be removed: %s", self.path, err.strerror)


def _parsed(made: _RoomFile) -> RoomReference:
    usable = np.array(made.usable, np.bool_)
    parts = np.array(made.echoes, np.float64)
    parts = parts.reshape(len(usable), -1, 2) if parts.size else np.zeros((len(usable), 0, 2))
    floor = FloorReference(_floor(made.floor), _floor(made.floor_kept), made.calm_s)
    is_half = (made.noise_db is None) != (made.noise_kept_db is None)
    if is_half or len(parts) != len(usable) or floor.first.shape != floor.kept.shape:
        raise ValueError("its parts do not fit each other")
    echoes = parts[..., 0] + 1j * parts[..., 1]
    return RoomReference(echoes, usable, made.noise_db, made.noise_kept_db, floor)


def _finite(floor: NDArray[np.float64]) -> list[float | None]:
    return [v if np.isfinite(v) else None for v in floor.tolist()]


def _floor(powers: tuple[float | None, ...]) -> NDArray[np.float64]:
    return np.array([np.inf if v is None else v for v in powers])
