"""RoomReference: what tamper is measured against, kept over a restart in one small JSON file.

Without it, somebody who covers or jams the sensor and then restarts radard, or its machine,
would have made that the room. A file that cannot be read, or is of another stream, counts as none.
"""

import json
import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.config.atomic import write_atomically
from radard.detect.interference import FloorReference

log = logging.getLogger("radard")
_FORMAT = "radard-room"
_MOST_BYTES = 1_000_000  # chosen: 200 times what an X2's takes


@dataclass(frozen=True, slots=True, eq=False)
class RoomReference:
    """Still echoes, noise and floors of a room; powers in sample units squared."""

    echoes: NDArray[np.complex128]  # learned of every cell, shape (n_cells, n_bins); empty: none
    usable: NDArray[np.bool_]  # cells that can be judged, shape (n_cells,)
    noise_db: float | None  # receiver's noise, as it was learned and as it has drifted since
    noise_kept_db: float | None
    floor: FloorReference


@dataclass(slots=True)
class RoomStore:
    """Keep one reference in a file; without a path, nothing.

    `stream` says, in any words, whose reference this is; that of another one is not used.
    """

    path: Path | None = None
    stream: str = ""
    _has_failed: bool = field(default=False, init=False)

    def load(self) -> RoomReference | None:
        """Return what was kept of this stream; None without it."""
        if self.path is None:
            return None
        try:
            with self.path.open("rb") as file:
                raw = json.loads(file.read(_MOST_BYTES))
            if raw["format"] == _FORMAT and raw["stream"] != self.stream:
                log.info("%s: of another stream or calibration, and not used", self.path)
                return None
            return _parsed(raw)
        except FileNotFoundError:
            return None
        except (OSError, ValueError, LookupError, TypeError, RecursionError, OverflowError) as err:
            log.warning("%s: the room's reference is unreadable and not used (%r)", self.path, err)
            return None

    def save(self, room: RoomReference) -> None:
        """Keep a reference; a failure is logged once, and tried again the next time."""
        if self.path is None:
            return
        content = {
            "format": _FORMAT,
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


def _parsed(raw: dict[str, Any]) -> RoomReference:
    """Return a file's reference; raises ValueError, LookupError or TypeError if it makes none."""
    if raw["format"] != _FORMAT or raw["format_version"] != 1:
        msg = f"format is not '{_FORMAT}', version 1"
        raise ValueError(msg)
    usable = np.array(raw["usable"], np.float64) > 0
    parts = np.array(raw["echoes"], np.float64)
    parts = parts.reshape(len(usable), -1, 2) if parts.size else np.zeros((len(usable), 0, 2))
    floor = FloorReference(_floor(raw["floor"]), _floor(raw["floor_kept"]), float(raw["calm_s"]))
    numbers = [raw["noise_db"], raw["noise_kept_db"]]
    noise_db, kept_db = (None if v is None else float(v) for v in numbers)
    known = np.array([floor.t_s, *(v for v in (noise_db, kept_db) if v is not None)])
    is_sound = np.isfinite(parts).all() and np.isfinite(known).all() and floor.t_s >= 0
    if not is_sound or floor.first.shape != floor.kept.shape or len(known) == 2:
        msg = "values make no sense"
        raise ValueError(msg)
    echoes = parts[..., 0] + 1j * parts[..., 1]
    return RoomReference(echoes, usable, noise_db, kept_db, floor)


def _finite(floor: NDArray[np.float64]) -> list[float | None]:
    return [v if np.isfinite(v) else None for v in floor.tolist()]


def _floor(raw: list[float | None]) -> NDArray[np.float64]:
    floor = np.array([np.inf if v is None else float(v) for v in raw])
    if not (floor > 0).all():
        msg = "a floor is not positive"
        raise ValueError(msg)
    return floor
