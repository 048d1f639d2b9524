"""How animals carry head and tail over their trunk, and those of the first generator.

A skeleton hung between feet and a moving trunk, which an `Action` gives. Resting breaths follow
``53.5 M^-0.26`` a minute (Stahl 1967, recalled); panting is at 4 to 6 Hz (recalled).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from x2radar.sim.bodies.body import Breath
from x2radar.sim.bodies.skeleton.skeleton import ENDS, SIDES, QuadrupedBuild, direction, two_links
from x2radar.sim.bodies.skeleton.species import Band, Species
from x2radar.sim.bodies.wander import Wander, bouts, smooth_step
from x2radar.sim.points import UP, Array, Ends, Motion, Pose

_WIDEST_WAG_RAD = 1.1  # a tail does not reach beside the body (recalled)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trunk:
    """Place and attitude of a trunk at given times."""

    middle_m: Array  # (n_slow, 3): half-way between hip and shoulder
    heading_rad: Array  # (n_slow,)
    pitch_rad: Array  # (n_slow,): up at the shoulder
    nod: Array | float = 0.0  # (n_slow,): -1 to 1, once or twice a stride; 0 at rest
    turn_rad_s: Array | float = 0.0  # (n_slow,): turn rate; the head looks into the bend


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Manner:
    """How an animal carries and moves its head and tail."""

    neck_rad: float  # how far the neck points up
    head_rad: float  # and the head
    nod_rad: float  # amplitude of the neck's nod
    gaze: Wander  # what is added to the yaw of neck and head, and to their pitch, in radians
    tail_rad: float  # how far the tail points up
    wag_hz: float
    wag_rad: float  # amplitude of the wag
    wag_lag_rad: float  # how far each third of the tail lags behind the one before
    bout: Wander | None = None  # the tail wags where it, -1 to 1, is above `wag_above`; or always
    wag_above: float = -2.0
    down: Wander | None = None  # the nose is at the floor where it, -1 to 1, is below `down_below`
    down_below: float = -2.0
    down_rad: tuple[float, float] = (0.0, 0.0)  # how far neck and head point up then
    lick_hz: float = 0.0  # of the neck's strokes while the nose is down
    lick_rad: float = 0.0  # their amplitude; 0 for one that does not groom

    def over_legs(
        self, t_s: Array, build: QuadrupedBuild, trunk: Trunk, legs: Sequence[Ends]
    ) -> Pose:
        """Return the pose over legs, given as ends of their parts in the order of `QUADRUPED`."""
        b, middle, heading = build, trunk.middle_m, trunk.heading_rad
        long, left = direction(heading, trunk.pitch_rad), direction(heading + 0.5 * np.pi)
        above = np.cross(long, left)
        base = middle + 0.52 * b.back_m * long + 0.25 * b.half_depth_m * above
        neck, head = self._front(t_s, trunk)
        nape = base + b.neck_m * neck
        wags = self.wag_rad * (bouts(self.bout, t_s, self.wag_above) if self.bout else 1.0)
        tail = [middle - 0.56 * b.back_m * long + 0.3 * b.half_depth_m * above]
        for k in range(3):
            wag = wags * np.sin(2.0 * np.pi * self.wag_hz * t_s - k * self.wag_lag_rad)
            # The tail flattens out towards its tip.
            way = direction(heading + np.pi + wag, self.tail_rad * (1.0 - 0.2 * k))
            tail.append(tail[-1] + b.tail_m / 3.0 * way)
        ends = [
            (middle - 0.5 * b.back_m * long, middle + 0.5 * b.back_m * long),
            (middle + 0.3 * b.back_m * long, middle + 0.54 * b.back_m * long),
            (middle - 0.54 * b.back_m * long, middle - 0.3 * b.back_m * long),
            (base, nape),
            (nape - 0.15 * b.head_m * head, nape + 0.85 * b.head_m * head),
            *pairwise(tail),
            *legs,
        ]
        return Pose.between(ends, left[:, None])

    def _front(self, t_s: Array, trunk: Trunk) -> tuple[Array, Array]:
        """Return unit vectors along neck and head."""
        gaze = self.gaze.at(t_s)
        yaw = trunk.heading_rad + gaze[:, 0] + np.clip(0.2 * trunk.turn_rad_s, -0.5, 0.5)
        nod, down = self.nod_rad * trunk.nod + gaze[:, 1], np.zeros(len(t_s))
        if self.down:
            down = smooth_step((self.down_below - self.down.at(t_s)[:, 0]) / 0.4 + 0.5)
            lick = self.lick_rad * np.sin(2.0 * np.pi * self.lick_hz * t_s)
            nod = (1.0 - 0.8 * down) * nod + down * lick
        neck = direction(yaw, self.neck_rad + down * (self.down_rad[0] - self.neck_rad) + nod)
        pitch = self.head_rad + down * (self.down_rad[1] - self.head_rad) + 0.5 * nod
        return neck, direction(yaw + 0.5 * gaze[:, 0], pitch)


def draw_manner(
    rng: np.random.Generator, build: QuadrupedBuild, species: Species, style: str, nod_rad: float
) -> tuple[Manner, Breath]:
    """Draw what an animal does with head, tail and chest, in a style of `PET_STYLES`."""
    u = rng.uniform(0.0, 1.0, 8)
    sits = style in {"sit", "groom", "scratch"}
    stays = sits or style in {"stand", "lie", "pant", "play"}
    neck = _in(species.neck_rad, u[0])
    if style in {"stalk", "lie", "pant"}:
        neck = 0.4 * u[0] + (0.2 if style == "pant" else -0.1)
    # On the floor the tail of one that sits or lies is level.
    rise = 0.0 if sits or style in {"lie", "pant"} else _in(species.rise_rad, u[1])
    wag_hz, wag_rad, lag = _wag(rng, build, float(rise), species)
    look = np.array([0.7, 0.2] if stays else [0.25, 0.05])
    always = species.tail_moves.tip_mps is None
    lazy = {"sit": -0.3, "stand": -0.3, "lie": 0.5, "pant": 0.3}.get(style, 0.1)
    manner = Manner(
        neck_rad=float(neck),
        head_rad=float(-0.35 + 0.35 * u[2]),
        nod_rad=nod_rad * float(0.6 + 0.8 * u[3]),
        gaze=Wander(rng, look, 0.6 * look),
        down=Wander(rng, [1.0], [0.35]),
        down_below={"sniff": 0.45, "lie": -0.3, "groom": 0.4}.get(style, -2.0),
        down_rad={"lie": (-0.25, 0.0), "groom": (-0.9, -1.2)}.get(style, (-1.25, -1.0)),
        lick_hz=float(1.5 + 2.0 * u[3]),
        lick_rad=float(0.10 + 0.20 * u[2]) if style == "groom" else 0.0,
        tail_rad=float(rise),
        wag_hz=wag_hz,
        wag_rad=wag_rad,
        wag_lag_rad=lag,
        bout=Wander(rng, [1.0], [0.4]),
        wag_above=-2.0 if always else lazy + 0.6 * float(u[4] - 0.5),
    )
    size_m = (0.0005 if style == "pant" else 0.0011) * build.mass_kg**0.33 * (0.7 + 0.6 * u[6])
    per_minute = 53.5 * build.mass_kg**-0.26 * (0.75 + 0.4 * u[5])
    per_minute = float(np.clip(per_minute, *species.breaths_per_min))
    # Going about takes more air than resting does.
    rate_hz = per_minute / 60.0 * (1.0 if stays and style != "play" else 1.8)
    rate_hz = 4.0 + 2.0 * u[5] if style == "pant" else rate_hz
    return manner, Breath(size_m, rate_hz, 2.0 * np.pi * u[7])


def _wag(
    rng: np.random.Generator, build: QuadrupedBuild, rise_rad: float, species: Species
) -> tuple[float, float, float]:
    """Return frequency, amplitude and lag of a tail's wag."""
    u, v, w = rng.uniform(0.0, 1.0, 3)
    moves = species.tail_moves
    lag = _in(moves.lag_rad, w)
    if moves.tip_mps is None:
        return _in(moves.hz, u), _in(moves.rad, v), lag
    (slowest_hz, fastest_hz), (least_mps, most_mps) = (moves.hz[0], sum(moves.hz)), moves.tip_mps
    thirds = np.cos(rise_rad * np.array([1.0, 0.8, 0.6])) * np.exp(-1j * lag * np.arange(3))
    arm = 2.0 * np.pi * build.tail_m * float(np.abs(thirds.mean()))
    tip = min(least_mps + (most_mps - least_mps) * u, fastest_hz * arm * _WIDEST_WAG_RAD)
    slowest = max(slowest_hz, tip / (arm * _WIDEST_WAG_RAD))
    hz = slowest + (fastest_hz - slowest) * v
    return float(hz), float(tip / (arm * hz)), lag


def _in(band: Band, share: float) -> float:
    return float(band[0] + band[1] * share)


_STIFF_TO = 0.85  # of a leg's length; beyond it, shoulder blades and hips give


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stance(Trunk):
    """Trunk and paws at given times."""

    paw_m: Array  # (n_slow, 4, 3): soles, in the order of `LEGS`


Action = Callable[[Array], Stance]
"""Where trunk and paws are at times of shape (n_slow,); a function of time alone."""


def hung(build: QuadrupedBuild, action: Action, manner: Manner) -> Motion:
    """Return the motion of an animal by what it does, and how it carries head and tail."""
    b = build
    end, side = 0.5 * ENDS * b.back_m, 0.9 * SIDES * b.half_track_m

    def pose(t_s: Array) -> Pose:
        s = action(t_s)
        ahead, left = direction(s.heading_rad), direction(s.heading_rad + 0.5 * np.pi)
        joint = s.middle_m[:, None] + end[:, None] * direction(s.heading_rad, s.pitch_rad)[:, None]
        joint = joint + side[:, None] * left[:, None]
        ankle = s.paw_m + 0.25 * b.paw_m * UP
        bend = -ENDS[:, None] * ahead[:, None]
        knee, top = two_links(ankle, joint, b.lower_m, b.upper_m, bend, soft_from=_STIFF_TO)
        toes = 0.5 * b.paw_m * ahead
        legs: list[Ends] = []
        for k in range(4):
            paw = (ankle[:, k] - toes, ankle[:, k] + toes)
            legs += [(knee[:, k], top[:, k]), (ankle[:, k], knee[:, k]), paw]
        return manner.over_legs(t_s, b, s, legs)

    return pose
