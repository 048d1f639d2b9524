"""Tamper: the sensor is covered, was moved, or jammed.

What stands still in a room is the sensor's fingerprint, learned cell by cell (0.3 m of range) and
compared with every dwell. *Covered*: the median level of still echoes changed by `covered_db`.
*Moved*: the median coherence of a cell's bins fell below `moved_coherence`, a common phase apart.
*Noise*: the receiver's noise changed by `noise_db`, or many samples are at one limit.
*Interference*: see `radard.detect.interference`. Each must last `hold_s`, a quarter of it when
twice as large; a cell is judged only while it stands still. No still echoes for `_BLIND_S`: the
antenna is unplugged or covered. What is compared with is kept over a restart, in one small NumPy
file: else, who covers or jams the sensor and restarts radard would have made that the room.
"""

import io
import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from radard.config.sections import TamperSection
from radard.detect.gate import Gate
from radard.detect.interference import (
    CELL_M,
    MAX_DRIFT_DB,
    MEMORY_S,
    NO_FLOOR,
    URGENT,
    FloorReference,
    InterferenceWatch,
    quantile,
)
from radard.stream.ring import Dwell
from x2radar.atomic import write_atomically

log = logging.getLogger("radard")
TamperKind = Literal["covered", "moved", "noise", "interference"]
_TINY = 1e-300  # instead of zero power
_STILL = 0.3  # a cell is still if less of its energy is unrest: see tests/detect/test_tamper.py
_MIN_CELLS = 3  # a median over fewer is one piece of furniture
_BLIND_S = 30.0  # of noise without echoes: people hide the noise, so nobody is there
_CLIPPED = 0.1  # of a dwell's samples; without clipping one or two are the largest
_KEEP_EVERY_S = 600.0  # the reference follows the room as slowly
_PARTS = 4  # of a dwell, for the unrest
_EVERY = 4  # of so many frames one is looked at
_NOISE_FRAMES = 16
_MIN_WHITE, _MAX_WHITE = 0.8, 1.25  # second over first differences
_MAX_SPREAD_DB = 6.0  # of the noise over range


@dataclass(frozen=True, slots=True, eq=False)
class CellReading:
    """What one dwell shows, cell by cell; powers in sample units squared."""

    echoes: NDArray[np.complex128]  # mean over the dwell, shape (n_cells, n_bins)
    energy: NDArray[np.float64]  # sum over a cell's bins of the means' power, shape (n_cells,)
    # Likewise, of how the means over quarters of the dwell differ from that over all.
    unrest: NDArray[np.float64]
    noise_db: float | None  # receiver's noise; None where motion hides it
    at_limit: float  # share of samples with a part as large as any


def read_cells(dwell: Dwell) -> CellReading | None:
    """Return the reading of a dwell; None when it has no room for two cells or four parts."""
    n_bins = max(1, round(CELL_M / dwell.axis.bin_length_m))
    n_cells = dwell.frames.shape[1] // n_bins
    rows = dwell.frames if not dwell.n_lost else dwell.frames[dwell.valid]
    # Every fourth frame tells as much about what stands still, where there are enough.
    rows = rows[:: _EVERY if len(rows) >= 8 * _EVERY else 1]
    n_rows = len(rows) // _PARTS * _PARTS
    if n_cells < 2 or n_rows == 0:
        return None
    used = rows[-n_rows:, : n_cells * n_bins]
    parts = used.reshape(_PARTS, n_rows // _PARTS, -1).mean(axis=1, dtype=np.complex128)
    mean = parts.mean(axis=0)
    size = np.maximum(np.abs(used.real), np.abs(used.imag))
    shape = (n_cells, n_bins)
    return CellReading(
        echoes=mean.reshape(shape),
        energy=power_of(mean).reshape(shape).sum(axis=1),
        unrest=power_of(parts - mean).mean(axis=0).reshape(shape).sum(axis=1),
        noise_db=_noise_db(dwell, shape),
        at_limit=float((size == size.max()).mean()) if size.any() else 0.0,
    )


def is_frozen(dwell: Dwell) -> bool:
    """Return whether the newest frames are all the same: a receiver that lives has noise."""
    rows = dwell.frames[dwell.valid][-_NOISE_FRAMES:]
    return len(rows) >= 4 and bool((rows[1:] == rows[0]).all())


def _noise_db(dwell: Dwell, shape: tuple[int, int]) -> float | None:
    """Return the noise of the newest frames, where first and second differences agree."""
    # White noise of power s has differences of power 2 s and second differences of 6 s; motion
    # that the frames follow has less in the second. Motion that they do not follow looks
    # white, but not alike at all ranges.
    n = min(_NOISE_FRAMES, len(dwell.frames))
    if n < 4 or not dwell.valid[-n:].all():
        return None
    rows = dwell.frames[-n:, : shape[0] * shape[1]].astype(np.complex128)
    steps = rows[1:] - rows[:-1]
    first = _cell_power(steps, shape) / 2
    second = _cell_power(steps[1:] - steps[:-1], shape) / 6
    if not (second > 0).all():
        return None
    white = second / first
    level_db = 10 * np.log10(second)
    is_noise = (
        quantile(white, 0.1) >= _MIN_WHITE
        and quantile(white, 0.5) <= _MAX_WHITE
        and quantile(level_db, 0.9) - quantile(level_db, 0.1) <= _MAX_SPREAD_DB
    )
    return quantile(level_db, 0.5) if is_noise else None


def power_of(x: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Return the power of every sample."""
    return np.asarray(x.real**2 + x.imag**2)


def _cell_power(x: NDArray[np.complex128], shape: tuple[int, int]) -> NDArray[np.float64]:
    parts = x.view(np.float64)
    by_part = np.einsum("tn,tn->n", parts, parts) / len(x)
    return np.asarray(by_part.reshape(shape[0], -1).sum(axis=1) / shape[1])


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


@dataclass(frozen=True, slots=True)
class Finding:
    """One kind of tamper that holds now, and the figure that shows it, for people."""

    kind: TamperKind
    reason: str


class TamperWatch:
    """Compare dwells, `hop_s` apart, with the fingerprint of those before, or a `known` one."""

    def __init__(
        self, settings: TamperSection, hop_s: float = 1.0, known: RoomReference | None = None
    ) -> None:
        self._settings = settings
        self._hop_s = hop_s
        self._n_learn = max(1, round(settings.learn_s / hop_s))
        self._due: RoomReference | None = None
        self.relearn(known)

    @property
    def is_blind(self) -> bool:
        """Whether there are no still echoes to judge by, so far."""
        return len(self._usable) == 0

    @property
    def known(self) -> RoomReference | None:
        """What is compared with now; None before anything was learned."""
        floor = self._interference.reference
        if floor.t_s == 0 or (self.is_blind and self._noise_db is None):
            return None
        return RoomReference(self._echoes, self._usable, self._noise_db, floor)

    def take_due(self) -> RoomReference | None:
        """Return `known` when first known, and every ten minutes if all is well; else None."""
        due, self._due = self._due, None
        return due

    def relearn(self, known: RoomReference | None = None) -> None:
        """Forget every finding and the fingerprint: that of now, or a `known` one, is right."""
        kinds: tuple[TamperKind, ...] = ("covered", "moved", "noise")
        self._held = {kind: _Held() for kind in kinds}
        room, s = known or NO_REFERENCE, self._settings
        self._interference = InterferenceWatch(s.noise_db, s.hold_s, self._hop_s, room.floor)
        self._usable, self._echoes, self._noise_db = room.usable, room.echoes, room.noise_db
        # What the room will be learned from: still cells and readings, and noise.
        self._heard: list[tuple[NDArray[np.bool_], CellReading]] = []
        self._noise_heard: list[float] = []
        self._blind_s, self._kept_s = 0.0, _KEEP_EVERY_S if known else 0.0

    def update(
        self, dwell: Dwell, gate: Gate | None = None, *, is_passed_over: bool = False
    ) -> tuple[Finding, ...]:
        """Judge a whole dwell with its clutter, and learn from it; return what holds.

        `gate` has judged the same dwell (without one, no interference is looked for);
        `is_passed_over`: there is a verdict, and it is no alarm.
        """
        if gate is not None:
            self._interference.update(gate, dwell, is_passed_over=is_passed_over)
        cells = read_cells(dwell)
        if cells is None:
            return self._findings()
        if cells.at_limit >= _CLIPPED:
            self._hold("noise", True, "samples are at the receiver's limit", is_urgent=True)
            return self._findings()
        self._judge_noise(cells)
        if self._echoes.shape != cells.echoes.shape:
            # Nothing so far, or kept of a stream with other bins.
            self._usable, self._echoes = NO_REFERENCE.usable, NO_REFERENCE.echoes
            self._learn(cells)
        else:
            self._judge_echoes(cells)
        findings = self._findings()
        if not findings:
            self._kept_s -= self._hop_s
            if self._kept_s < 0 and (room := self.known) is not None:
                self._kept_s, self._due = _KEEP_EVERY_S, room
        return findings

    def _findings(self) -> tuple[Finding, ...]:
        held = [Finding(k, held.reason) for k, held in self._held.items() if held.is_on]
        if self._interference.reason:
            held.append(Finding("interference", self._interference.reason))
        return tuple(held)

    def _learn(self, cells: CellReading) -> None:
        """Sum up the still cells of `learn_s` of dwells; keep those that agree with themselves.

        With noise alone at all ranges there is no antenna, or a cover before it.
        """
        still, held = cells.unrest < _STILL * cells.energy, self._held["covered"]
        is_still = np.count_nonzero(still) >= _MIN_CELLS
        if is_still or cells.noise_db is not None:
            self._blind_s = 0.0 if is_still else self._blind_s + self._hop_s
        held.is_on = self._blind_s >= _BLIND_S
        held.reason = f"no still echoes for {_BLIND_S:.0f} s: is the antenna connected and clear?"
        if is_still:
            self._heard.append((still, cells))
        if len(self._heard) < self._n_learn:
            return
        stills = np.array([still for still, _ in self._heard])
        energy = np.where(stills, [each.energy for _, each in self._heard], 0).sum(axis=0)
        echoes = [each.echoes for _, each in self._heard]
        total, n_still = np.where(stills[..., None], echoes, 0).sum(axis=0), stills.sum(axis=0)
        agreed = power_of(total).sum(axis=1) > (1 - _STILL) * n_still * energy
        usable = agreed & (n_still > self._n_learn / 2)
        if np.count_nonzero(usable) >= _MIN_CELLS:
            self._usable, self._echoes = usable, total / np.maximum(n_still, 1)[:, None]
        self._heard.clear()

    def _judge_echoes(self, cells: CellReading) -> None:
        s = self._settings
        known = power_of(self._echoes).sum(axis=1)
        judged = self._usable & (cells.unrest < _STILL * np.maximum(cells.energy, known))
        if np.count_nonzero(judged) < _MIN_CELLS:
            return
        product = (cells.echoes * self._echoes.conj()).sum(axis=1)
        coherence = np.abs(product) / np.sqrt(cells.energy * known + _TINY)
        level_db = 10 * np.log10((cells.energy + _TINY) / (known + _TINY))
        level = quantile(level_db[judged], 0.5)
        alike = quantile(coherence[judged], 0.5)
        is_level = abs(level) >= s.covered_db
        is_shape = alike < s.moved_coherence
        is_far = abs(level) >= 2 * s.covered_db
        self._hold("covered", is_level, f"still echoes {_change(level)}", is_urgent=is_far)
        # Without level there is no shape: a covered sensor is not called moved as well.
        is_far, is_moved = alike < 0.75 * s.moved_coherence, is_shape and not is_level
        agree = f"echoes agree {alike:.2f} with the room's"
        self._hold("moved", is_moved, agree, is_urgent=is_far)
        if not (is_level or is_shape):
            # Follow the room within `MEMORY_S`; phases drift, so turn them.
            turn = product.conj() / np.maximum(np.abs(product), _TINY)
            step = np.where(judged, self._hop_s / MEMORY_S, 0.0)[:, None]
            self._echoes += step * (cells.echoes * turn[:, None] - self._echoes)

    def _judge_noise(self, cells: CellReading) -> None:
        if cells.noise_db is None:
            return
        if self._noise_db is None:
            self._noise_heard.append(cells.noise_db)
            if len(self._noise_heard) >= self._n_learn:
                learned_db = quantile(np.array(self._noise_heard), 0.5)
                self._noise_db = learned_db, learned_db
            return
        learned_db, now_db = self._noise_db
        change_db = cells.noise_db - now_db
        is_jump = abs(change_db) >= self._settings.noise_db
        is_far = abs(change_db) >= 2 * self._settings.noise_db
        self._hold("noise", is_jump, f"noise {_change(change_db)}", is_urgent=is_far)
        if not is_jump:
            drift_db = now_db + self._hop_s / MEMORY_S * change_db - learned_db
            drift_db = min(max(drift_db, -MAX_DRIFT_DB), MAX_DRIFT_DB)
            self._noise_db = learned_db, learned_db + drift_db

    def _hold(self, kind: TamperKind, is_now: bool, reason: str, *, is_urgent: bool) -> None:
        held = self._held[kind]
        if is_now != held.is_on:
            held.for_s += self._hop_s * (URGENT if is_now and is_urgent else 1)
            if held.for_s >= self._settings.hold_s:
                held.is_on, held.for_s, held.reason = is_now, 0.0, reason
        else:
            held.for_s = 0.0


@dataclass(slots=True)
class _Held:
    """One kind: whether it holds, and for how long the opposite was seen."""

    is_on: bool = False
    for_s: float = 0.0
    reason: str = ""


def _change(change_db: float) -> str:
    return f"{'fell' if change_db < 0 else 'rose'} {abs(change_db):.0f} dB"
