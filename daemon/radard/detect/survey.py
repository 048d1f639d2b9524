"""Survey of an empty room: from its dwells to a `Calibration`, and what that one promises.

For every dwell there is a factor u: how far its cells stand over u h times their level, in two of
three CPIs, with h how restless each bin is. Its logarithm is taken as normal, and what is
predicted for dwells to come is Student's t with as many degrees of freedom as there were dwells
without overlap, less one (Geisser 1993, recalled). No threshold is lower than the gate's own.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

from radard.config.sections import GateSettings
from radard.detect.calibration import Calibration, Provenance
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import DAY_S, Gate, decibels, level_over
from radard.detect.tracks import Tracker
from radard.dsp.cfar import cell_factor, two_of_three, usual_peak
from radard.dsp.velocity import CPI_S
from radard.errors import RadardError
from radard.stream.ring import Dwell

MIN_INDEPENDENT = 8  # dwells: Student's t promises nothing with fewer
_UNREST_DB = 6.0  # of a bin over its noise: breath is stronger
_PLACE_M = 0.5  # what moves less stays in its place
_SPAN = (-12.0, 12.0)  # of log u: beyond any room's

Array = NDArray[np.float64]


class RoomSurvey:
    """Listen to an empty room; `settings` are those of the gate that will use the calibration."""

    def __init__(self, settings: GateSettings, hop_s: float) -> None:
        self._settings = settings
        self._gate = Gate(settings, hop_s)
        self._remover = ClutterRemover()
        self._tracker = Tracker()
        self._hop_s = hop_s
        # Power, strongest cells, residue and noise of every dwell, as the gate has them.
        self._heard: list[tuple[Array, Array, Array, Array]] = []
        self._seen_m: list[float] = []
        self._paths: dict[int, tuple[float, float]] = {}
        self._n_skipped = 0
        self._last: Dwell | None = None

    @property
    def n_dwells(self) -> int:
        """Number of dwells that were taken and count."""
        return len(self._heard)

    def add(self, dwell: Dwell) -> bool:
        """Take a dwell, one after the other; return whether something moved in it."""
        moving = self._remover.remove(dwell) if dwell.is_whole else dwell
        if not moving.is_whole:
            self._n_skipped += 1
            return False
        gate = self._gate
        reading = gate.read(moving)
        tracks = self._tracker.update(moving, gate.background)
        self._heard.append((gate.power, gate.cell_peak, gate.residue, gate.noise))
        self._last = moving
        for track in tracks:
            low, high = self._paths.get(track.id, (track.range_m, track.range_m))
            self._paths[track.id] = min(low, track.range_m), max(high, track.range_m)
        self._seen_m += [track.range_m for track in tracks]
        self._seen_m += [reading.range_m] if reading.is_open else []
        return reading.is_open or bool(tracks)

    def check_empty(self, *, takes_machines: bool = False) -> None:
        """Raise RadardError if something moved; `takes_machines` lets what stays in place."""
        if self._last is None:
            raise RadardError("nothing was heard: no window was sound; see 'x2radar selftest'")
        range_m = self._last.axis.range_m
        power, noise = (np.mean([each[k] for each in self._heard], axis=0) for k in (0, 3))
        over_db = decibels(power) - decibels(noise)
        # Breath or a fan may stir without ever opening the gate.
        stirs = (noise > 0) & (over_db > _UNREST_DB)
        found_m = [*self._seen_m, *range_m[stirs].tolist()]
        if takes_machines:
            spans = self._paths.values()
            found_m = [m for span in spans if span[1] - span[0] > _PLACE_M for m in span]
        if found_m:
            raise RadardError(
                f"the room is not empty: something moves at {min(found_m):.1f} to "
                f"{max(found_m):.1f} m; leave it empty and try again; --with-machines takes what "
                "stays in its place"
            )

    def calibration(self, origin: Provenance, *, false_gates_per_day: float = 1.0) -> Calibration:
        """Return the calibration, its `origin` completed; RadardError if too little was heard."""
        last = self._last
        dwell_s = len(last.frames) / last.frame_rate_hz if last else 0.0
        independent = self.n_dwells * self._hop_s / max(dwell_s, self._hop_s)
        has_power = any(power.any() for power, *_ in self._heard)
        if last is None or independent < MIN_INDEPENDENT or not has_power:
            raise RadardError(
                f"too little was heard: {self.n_dwells} sound windows, {self._n_skipped} with "
                f"frames missing; give it a longer --duration, or see 'x2radar selftest'"
            )
        power, peaks, residues, _ = zip(*self._heard, strict=True)
        floor = np.mean(power, axis=0)
        levels = [level_over(floor, residue) for residue in residues]
        n_cpi = max(4, round(CPI_S * last.frame_rate_hz))
        usual = np.mean([peak.mean(axis=0) for peak in peaks], axis=0) / usual_peak(n_cpi)
        # A bin that happened to be calm is not calmer than noise.
        restless = np.maximum(_ratio(usual, floor), 1.0)
        share = min(0.5, false_gates_per_day * self._hop_s / DAY_S)
        demanded = self._settings.false_alarms_per_day * self._hop_s / DAY_S
        least = cell_factor(demanded, len(peaks[-1]), n_cpi, len(floor))
        log_u = _factors(peaks, [restless * level for level in levels])
        over = np.maximum(_reach(log_u, share, independent) * restless, least)
        log_u = _factors(peaks, [over * level for level in levels])
        predicted = _share_over(log_u, independent) * DAY_S / self._hop_s
        heard_s = (self.n_dwells - 1) * self._hop_s + dwell_s
        return Calibration(
            frame_rate_hz=last.frame_rate_hz,
            bin_length_m=last.axis.bin_length_m,
            range_offset_m=last.axis.range_offset_m,
            floor=floor,
            threshold_db=decibels(over),
            provenance=replace(
                origin,
                duration_s=round(heard_s, 3),
                n_dwells=self.n_dwells,
                false_gates_per_day=float(f"{predicted:.3g}"),
            ),
        )


def _factors(peaks: Sequence[Array], thresholds: Sequence[Array]) -> Array:
    """Return log u of every dwell, shape (n_dwells,): by how much it passes its threshold."""
    reached = [
        two_of_three(_ratio(peak, threshold).max(axis=1))[0]
        for peak, threshold in zip(peaks, thresholds, strict=True)
    ]
    return np.clip(np.log(np.maximum(reached, 1e-300)), *_SPAN)


def _ratio(values: Array, over: Array) -> Array:
    out = np.zeros(np.broadcast_shapes(values.shape, over.shape))
    return np.asarray(np.divide(values, over, out=out, where=over > 0))


def _reach(log_u: Array, share: float, independent: float) -> float:
    spread = log_u.std(ddof=1) * np.sqrt(1 + 1 / independent)
    reach = log_u.mean() - stdtrit(independent - 1, share) * spread
    return float(np.exp(min(reach, _SPAN[1])))


def _share_over(log_u: Array, independent: float) -> float:
    spread = float(log_u.std(ddof=1)) * np.sqrt(1 + 1 / independent)
    if spread == 0:
        return float(log_u.mean() > 0)
    return float(stdtr(independent - 1, log_u.mean() / spread))
