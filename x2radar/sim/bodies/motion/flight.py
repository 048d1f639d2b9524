"""How birds and moths fly: rounds about a point, fluttering, hops between perches, and wings."""

from dataclasses import dataclass, field

import numpy as np

from x2radar.sim.bodies.pose import Pose
from x2radar.sim.bodies.wander import Wander, smooth_step
from x2radar.sim.points import Array

_HOP_S = 0.25
"""How long a small bird hops (recalled)."""
_GRAVITY_MPS2 = 9.81


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A course through the air."""

    home_m: Array  # (3,): middle of the rounds, or first perch
    orbit_m: float  # radius of the rounds
    orbit_rad_s: float  # turn rate of the rounds; its sign is the way round
    orbit_rad: float  # angle at time 0
    wander: Wander  # offsets in x, y, z, in metres, and of the heading, in radians
    effort: Wander  # one number in -1 to 1; the wings rest where it is low
    rest_below: float  # how low: -2 for wings that never rest, 2 for wings that do so until a hop
    hop_s: Array = field(default_factory=lambda: np.zeros(0))  # when hops begin, in one period
    perch_m: Array = field(default_factory=lambda: np.zeros((0, 3)))  # where, from `home_m`
    period_s: float = 60.0  # after which the hops are repeated

    def at(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return place, heading and effort at times of shape (n_slow,).

        Shapes (n_slow, 3), in room coordinates, (n_slow,), counter-clockwise from the x axis, and
        (n_slow,): how hard the wings beat, 0 to 1.
        """
        offset = self.wander.at(t_s)
        turn = self.orbit_rad + self.orbit_rad_s * t_s
        place = self.home_m + offset[:, :3]
        place[:, 0] += self.orbit_m * np.cos(turn)
        place[:, 1] += self.orbit_m * np.sin(turn)
        ahead = np.copysign(0.5 * np.pi, self.orbit_rad_s)
        effort = smooth_step((self.effort.at(t_s)[:, 0] - self.rest_below) / 0.3 + 0.5)
        if self.hop_s.size:
            hop, aloft = self._hop(t_s)
            place += hop
            effort = np.maximum(effort, aloft)
        return place, turn + ahead + offset[:, 3], effort

    def _hop(self, t_s: Array) -> tuple[Array, Array]:
        """Return the offset from home, and how far through the air it is, 0 to 1."""
        within = np.mod(t_s, self.period_s)
        # Before the first hop of a period the last one's end still holds.
        k = np.searchsorted(self.hop_s, within, side="right") - 1
        since = within - self.hop_s[k] + np.where(k < 0, self.period_s, 0.0)
        start, end = self.perch_m[k], self.perch_m[(k + 1) % len(self.hop_s)]
        share = np.clip(since / _HOP_S, 0.0, 1.0)
        offset = start + (end - start) * smooth_step(share)[:, None]
        aloft = np.where(share < 1.0, np.sin(np.pi * share) ** 2, 0.0)
        # A hop of 0.25 s under gravity rises g T^2 / 8 = 77 mm.
        offset[:, 2] += 0.077 * aloft
        return offset, aloft


@dataclass(frozen=True, slots=True)
class FlyerBuild:
    """What a flying animal is like."""

    body_m: float
    span_m: float
    beat_hz: float
    stroke_rad: float
    stroke_mean_rad: float
    lag_rad: float
    pitch_rad: float
    breath_hz: float
    breath_m: float
    folds: bool


@dataclass(frozen=True, slots=True, eq=False)
class Flying:
    """A bird or a moth: body, head, tail, and two parts of each wing; a `Motion`."""

    build: FlyerBuild
    flight: Flight

    def pose(self, t_s: Array) -> Pose:
        """Return the pose of all parts; see `Motion`."""
        b = self.build
        place, heading, effort = self.flight.at(t_s)
        cos, sin, zero = np.cos(heading), np.sin(heading), np.zeros_like(heading)
        nose = np.stack([cos, sin, zero], axis=-1) * np.cos(b.pitch_rad)
        nose[:, 2] = np.sin(b.pitch_rad)
        left = np.stack([-sin, cos, zero], axis=-1)
        up = np.cross(nose, left)

        beat = 2.0 * np.pi * b.beat_hz * t_s
        # The body hangs from wings that lift it in half of each beat only: it goes through
        # g / omega^2, opposite to the wings.
        body = place.copy()
        body[:, 2] -= effort * _GRAVITY_MPS2 / (2.0 * np.pi * b.beat_hz) ** 2 * np.sin(beat)
        body[:, 2] += b.breath_m * (1.0 - effort) * np.sin(2.0 * np.pi * b.breath_hz * t_s)

        inner, outer = 0.22 * b.span_m, 0.28 * b.span_m
        centre, axis = np.empty((len(t_s), 7, 3)), np.empty((len(t_s), 7, 3))
        axis[:, :3] = nose[:, None]
        for k, along in enumerate((0.0, 0.6, -0.75)):
            centre[:, k] = body + along * b.body_m * nose
        fold = (1.0 - effort)[:, None] * (1.0 if b.folds else 0.0)
        lags = (0, b.lag_rad)
        angles = [b.stroke_mean_rad + b.stroke_rad * effort * np.sin(beat - p) for p in lags]
        for first, to in ((3, left), (5, -left)):
            near, far = (_wing(a, to, up, nose, fold) for a in angles)
            wrist = body + inner * near
            axis[:, first], axis[:, first + 1] = near, far
            centre[:, first] = body + 0.5 * inner * near
            centre[:, first + 1] = wrist + 0.5 * outer * far
        return Pose(centre, axis, left[:, None])


def _wing(angle_rad: Array, to: Array, up: Array, nose: Array, fold: Array) -> Array:
    """Return the unit vector along a wing at an angle over the horizon, folded or not."""
    out = np.cos(angle_rad)[:, None] * to + np.sin(angle_rad)[:, None] * up
    # A folded wing points backwards and a little outwards, so the mix is never zero.
    mix = out + fold * (0.2 * to - nose - out)
    return np.asarray(mix / np.sqrt((mix**2).sum(axis=1))[:, None], dtype=np.float64)
