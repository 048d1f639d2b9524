"""RoomReference: what tamper is measured against, kept over a restart in one small NumPy file.

Else, who covers or jams the sensor and restarts radard would have made that the room.
"""

import io
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.detect.interference import NO_FLOOR, FloorReference
from x2radar.atomic import write_atomically

log = logging.getLogger("radard")


@dataclass(frozen=True, slots=True, eq=False)
class RoomReference:
    """Still echoes, noise and floors of a room; powers in sample units squared."""

    echoes: NDArray[np.complex128]  # learned of every cell, shape (n_cells, n_bins); empty: none
    usable: NDArray[np.bool_]  # cells that can be judged, shape (n_cells,)
    # Receiver's noise, as it was learned and as it has drifted since; None: not known.
    noise_db: tuple[float, float] | None
    floor: FloorReference


NO_REFERENCE = RoomReference(
    np.zeros((0, 0), np.complex128), np.zeros(0, np.bool_), None, NO_FLOOR
)


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
            with np.load(io.BytesIO(self.path.read_bytes()), allow_pickle=False) as kept:
                if str(kept["stream"]) != self.stream:
                    log.info("%s: of another stream or calibration, and not used", self.path)
                    return None
                return _parsed(kept)
        except FileNotFoundError:
            return None
        except Exception as err:  # noqa: BLE001 - a damaged archive raises all kinds of errors
            log.warning("%s: the room's reference is unreadable and not used (%s)", self.path, err)
            return None

    def save(self, room: RoomReference) -> None:
        """Keep a reference; a failure is logged once, and tried again the next time."""
        if self.path is None:
            return
        whole = io.BytesIO()
        np.savez(
            whole,
            stream=self.stream,
            echoes=room.echoes,
            usable=room.usable,
            noise_db=np.array(room.noise_db or (np.nan, np.nan)),
            floor=np.stack([room.floor.first, room.floor.kept]),
            calm_s=room.floor.t_s,
        )
        try:
            write_atomically(self.path, whole.getvalue(), mode=0o600)
            self._has_failed = False
        except OSError as err:
            if not self._has_failed:
                log.warning("%s: cannot keep the room's reference: %s", self.path, err.strerror)
            self._has_failed = True

    def forget(self, stream: str) -> None:
        """Remove what was kept; what will be kept is of `stream`."""
        self.stream = stream
        if self.path is None:
            return
        try:
            self.path.unlink(missing_ok=True)
        except OSError as err:
            log.warning("%s: cannot be removed: %s", self.path, err.strerror)


def _parsed(kept: Mapping[str, Any]) -> RoomReference:
    """Return the reference of a file's arrays; noise that is not known is NaN there."""
    names = ("echoes", "usable", "noise_db", "floor", "calm_s")
    echoes, usable, noise_db, floor, calm_s = (kept[name] for name in names)
    is_one = (echoes.dtype, echoes.ndim) == (np.complex128, 2) and np.isfinite(echoes).all()
    is_one = is_one and (usable.dtype, usable.shape) == (np.bool_, echoes.shape[:1])
    is_one = is_one and (floor.dtype, floor.ndim, len(floor)) == (np.float64, 2, 2)
    if not (is_one and (floor > 0).all() and float(calm_s) >= 0):
        raise ValueError("its parts do not fit each other")
    learned_db, drifted_db = noise_db.tolist()
    known_db = None if np.isnan(learned_db + drifted_db) else (learned_db, drifted_db)
    reference = FloorReference(floor[0], floor[1], float(calm_s))
    return RoomReference(echoes, usable, known_db, reference)
