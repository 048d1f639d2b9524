"""Tracks: detections followed over time, so that each body can be judged by itself.

A Kalman filter with nearly constant velocity follows each body through the peaks of residual power
(`radard.dsp.cfar`) of blocks of 0.12 s. A peak that no track takes begins a candidate, which is
born when hit in 4 of its first 6 blocks, numbered from 1. A track dies when not hit for
`_COAST_S`, also behind the edge of the swath, or when it has moved along with an older one, closer
than a body is long, for a second.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.dsp.cfar import Peak, find_peaks, power_map
from radard.dsp.velocity import CPI_S
from radard.stream.ring import Dwell

_MIN_DB = 9.0  # of a peak over its floor
_ACCELERATION_MPS2 = 1.5  # sigma of what a body does between blocks
_RANGE_ERROR_M = 0.08  # sigma of a peak
_BESIDE_M = 0.35  # nearer peaks may be one body's
_COAST_S = 1.5  # a track lives so long without a hit
_MAX_TRACKS = 8
_BIRTH_HITS = 4  # of a candidate's first blocks
_MISSES = 2  # among them: with more it is not born any more
_FIRST_SPEED_MPS = 1.5  # sigma of a candidate's range rate: a walker's
_LEAVE_M = 0.3  # a track may coast so far behind the edge
_SLOW_DOWN_S = 0.3  # time constant of the speed of a track without hits
_POWER_MEMORY = 0.2  # share of a new hit in the power
_SAME_RATE_MPS = 0.4  # tracks closer in speed move together
_REACH = 4.0  # sigmas within which a peak may be a body's
_POWER_SPREAD_DB = 6.0  # sigma of a peak's power about its track's
_MERGE_S = 1.0  # a track dies after so long beside an older one
_HALF_WIDTH_M, _TAPER_M = 0.5, 0.2  # of a track's gate, and of its edges


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A body at the end of a dwell."""

    id: int  # number in the order of birth, from 1; never given twice
    range_m: float
    radial_velocity_mps: float  # positive when it approaches
    power_db: float  # smoothed peak power over the floor
    path_m: NDArray[np.float64]  # its range at every frame; before it was seen, its first


class _Body:
    """A candidate or track while it is followed; range rate is positive when receding."""

    def __init__(self, time_s: float, peak: Peak) -> None:
        self.time_s = self.seen_s = self.apart_s = time_s
        self.range_m, self.rate_mps, self.power_db = peak.range_m, 0.0, peak.power_db
        self.variance = [_RANGE_ERROR_M**2, 0.0, _FIRST_SPEED_MPS**2]
        self.id, self.hits, self.blocks = 0, 1, 1
        self.nodes = [(time_s, peak.range_m)]

    def predict(self, time_s: float) -> None:
        dt = time_s - self.time_s
        self.time_s = time_s
        self.blocks += 1
        self.range_m += self.rate_mps * dt
        if time_s - self.seen_s > _SLOW_DOWN_S / 2:
            self.rate_mps *= float(np.exp(-dt / _SLOW_DOWN_S))
        rr, rv, vv = self.variance
        q = _ACCELERATION_MPS2**2 * dt
        self.variance = [
            rr + 2 * dt * rv + dt * dt * vv + q * dt * dt / 3,
            rv + dt * vv + q * dt / 2,
            vv + q,
        ]

    def correct(self, peak: Peak) -> None:
        rr, rv, vv = self.variance
        gain_r, gain_v = rr / (rr + _RANGE_ERROR_M**2), rv / (rr + _RANGE_ERROR_M**2)
        surprise = peak.range_m - self.range_m
        self.range_m += gain_r * surprise
        self.rate_mps += gain_v * surprise
        self.variance = [(1 - gain_r) * rr, (1 - gain_r) * rv, vv - gain_v * rv]
        self.power_db += _POWER_MEMORY * (peak.power_db - self.power_db)
        self.seen_s = self.time_s
        self.hits += 1


class Tracker:
    """Follow the bodies of one stream."""

    def __init__(self) -> None:
        self._bodies: list[_Body] = []
        self._n_born = 0
        self._time_s = -np.inf

    @property
    def is_following(self) -> bool:
        """Whether there is a track or a candidate for one: without, dwells may be left out."""
        return bool(self._bodies)

    def reset(self) -> None:
        """Forget all bodies, as after a restart of the module; ids go on."""
        self._bodies = []
        self._time_s = -np.inf

    def update(self, dwell: Dwell, floor: NDArray[np.float64]) -> tuple[Track, ...]:
        """Take the next dwell, less its clutter, and `Gate.background`; return what lives then."""
        rate_hz = dwell.frame_rate_hz
        n_rows = len(dwell.frames)
        if np.isfinite(self._time_s):
            # Blocks already seen are not computed again.
            cpi = max(4, round(CPI_S * rate_hz))
            fresh = (dwell.t_s - self._time_s) * rate_hz
            n_rows = min(n_rows, max(1, int(np.ceil(fresh / cpi))) * cpi)
        frames, valid = dwell.frames[-n_rows:], dwell.valid[-n_rows:]
        chart = power_map(
            frames, valid, dwell.axis, frame_rate_hz=rate_hz, end_s=dwell.t_s, floor=floor
        )
        swath = (float(dwell.axis.range_m[0]), float(dwell.axis.range_m[-1]))
        block_s = chart.n_looks / rate_hz
        for time_s, peaks in zip(chart.time_s.tolist(), find_peaks(chart, _MIN_DB), strict=True):
            if time_s > self._time_s + block_s / 2:
                self._step(time_s, peaks, swath)
                self._time_s = time_s
        return self._alive(dwell)

    def _step(self, time_s: float, peaks: list[Peak], swath: tuple[float, float]) -> None:
        for body in self._bodies:
            body.predict(time_s)
            # A track that leaves waits at the edge until it has coasted to its end.
            body.range_m = min(max(body.range_m, swath[0] - _LEAVE_M), swath[1] + _LEAVE_M)
        taken = self._assign(peaks)
        for i, j in taken.items():
            self._bodies[i].correct(peaks[j])
        for body in self._bodies:
            body.nodes.append((time_s, body.range_m))
        self._bury(time_s)
        for body in self._bodies:
            if not body.id and body.hits >= _BIRTH_HITS and self._is_alone(body.range_m):
                self._n_born += 1
                body.id = self._n_born
        free = set(range(len(peaks))) - set(taken.values())
        for j in sorted(free):
            if all(abs(b.range_m - peaks[j].range_m) >= _BESIDE_M for b in self._bodies):
                self._bodies.append(_Body(time_s, peaks[j]))

    def _assign(self, peaks: list[Peak]) -> dict[int, int]:
        """Give every body at most one peak: nearest pairs first, tracks before candidates."""
        pairs = []
        for i, body in enumerate(self._bodies):
            spread_m = (body.variance[0] + _RANGE_ERROR_M**2) ** 0.5
            reach_m = min(_REACH * spread_m, _BESIDE_M)
            for j, peak in enumerate(peaks):
                off_m = abs(peak.range_m - body.range_m)
                if off_m <= reach_m:
                    # Bodies that cross are told apart by how strong they are, too.
                    power = (peak.power_db - body.power_db) / _POWER_SPREAD_DB
                    far = (off_m / spread_m) ** 2 + power**2
                    pairs.append((body.id == 0, far, i, j))
        taken: dict[int, int] = {}
        for _, _, i, j in sorted(pairs):
            if i not in taken and j not in taken.values():
                taken[i] = j
        return taken

    def _bury(self, time_s: float) -> None:
        for body in self._bodies:
            if not any(
                0 < other.id < body.id
                and abs(other.range_m - body.range_m) < _BESIDE_M / 2
                and abs(other.rate_mps - body.rate_mps) < _SAME_RATE_MPS
                for other in self._bodies
            ):
                body.apart_s = time_s
        self._bodies = [
            body
            for body in self._bodies
            if time_s - body.apart_s < _MERGE_S
            # A candidate with too many blocks without a hit can no longer be born.
            and (
                time_s - body.seen_s < _COAST_S if body.id else body.blocks - body.hits <= _MISSES
            )
        ]

    def _is_alone(self, range_m: float) -> bool:
        tracks = [body for body in self._bodies if body.id]
        return len(tracks) < _MAX_TRACKS and all(
            abs(body.range_m - range_m) >= _BESIDE_M for body in tracks
        )

    def _alive(self, dwell: Dwell) -> tuple[Track, ...]:
        n_slow, rate_hz = len(dwell.frames), dwell.frame_rate_hz
        frame_s = dwell.t_s - (n_slow - 0.5 - np.arange(n_slow)) / rate_hz
        tracks = []
        for body in sorted(self._bodies, key=lambda each: each.id):
            while len(body.nodes) > 1 and body.nodes[1][0] < frame_s[0]:
                del body.nodes[0]
            if body.id:
                now_m = body.range_m + body.rate_mps * (dwell.t_s - body.time_s)
                path_m = np.interp(frame_s, *np.array([*body.nodes, (dwell.t_s, now_m)]).T)
                # + 0.0 turns -0.0 into 0.0.
                velocity_mps = -body.rate_mps + 0.0
                tracks.append(Track(body.id, now_m, velocity_mps, body.power_db, path_m))
        return tuple(tracks)


def range_gates(paths_m: NDArray[np.float64], range_m: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return every track's share of each cell, 0 to 1, (n_tracks, n_slow, n_range), float32.

    `paths_m` is the range of every track at every frame, shape (n_tracks, n_slow), `range_m` the
    range axis. `_HALF_WIDTH_M` from a track its weight is one half; edges are raised cosines of
    `_TAPER_M`. The weights of a cell sum to at most one, to 1e-6.
    """
    paths = paths_m.astype(np.float32)
    off = np.abs(range_m.astype(np.float32) - paths[..., None])
    gates = _edge((_HALF_WIDTH_M - off) / _TAPER_M)
    for i in range(len(paths)):
        for j in range(i):
            if np.any(np.abs(paths[i] - paths[j]) < 2 * _HALF_WIDTH_M + _TAPER_M):
                share = _edge((off[j] - off[i]) / (2 * _TAPER_M))
                gates[i] *= share
                gates[j] *= 1 - share
    return gates


def _edge(x: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(0.5 + 0.5 * np.sin(np.pi * np.clip(x, -0.5, 0.5)), np.float32)
