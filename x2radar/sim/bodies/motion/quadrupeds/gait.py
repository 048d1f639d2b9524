"""Four-legged animals of the first generator: how they go, and what they do in one place.

Speed is measured by the Froude number ``Fr = v^2 / (g h)``, h the height of the hip; animals
of any size move alike at equal Froude numbers (Alexander and Jayes, A dynamic similarity
hypothesis for the gaits of quadrupedal mammals, 1983; coefficients recalled).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.hung import Action, Stance
from x2radar.sim.bodies.path.feet import Feet, Gait
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.skeleton import ENDS, LEGS, SIDES, QuadrupedBuild, direction
from x2radar.sim.bodies.skeleton.species import Species
from x2radar.sim.bodies.wander import Wander, bouts, smooth_step
from x2radar.sim.points import UP, Array

GRAVITY_MPS2 = 9.81
STANDING = 0.97  # height of a standing trunk's middle, in hip heights: legs are a little bent

DUTY = (0.28, 0.70)  # least and greatest duty factor: galloping and creeping animals (recalled)


@dataclass(frozen=True, slots=True)
class Footwork:
    """An order of footfalls, with what the trunk does in it."""

    offset: tuple[float, float, float, float]  # landing of each of `LEGS`, strides after the first
    bobs: int  # how often the trunk goes up and down in a stride
    is_vault: bool  # highest over the standing leg, as on stilts; else lowest, as on springs
    bob: float  # amplitude of either end of the trunk, in hip heights
    sway: float  # amplitude to the sides, once a stride, in hip heights
    nod_rad: float  # amplitude of the neck's nod


FOOTWORK: Mapping[str, Footwork] = {
    # Lateral sequence: hind, fore of the same side, other hind, other fore.
    "walk": Footwork((0.0, 0.25, 0.5, 0.75), 2, True, 0.022, 0.025, 0.10),
    "trot": Footwork((0.0, 0.5, 0.5, 0.0), 2, False, 0.035, 0.010, 0.04),
    "pace": Footwork((0.0, 0.06, 0.5, 0.56), 2, False, 0.028, 0.050, 0.05),
    # Right lead: left hind, then right hind with left fore, then right fore.
    "canter": Footwork((0.0, 0.30, 0.28, 0.56), 1, False, 0.070, 0.010, 0.16),
    # Half-bound: the hind feet nearly at once, then the fore feet.
    "bound": Footwork((0.0, 0.46, 0.06, 0.53), 1, False, 0.090, 0.010, 0.10),
}
"""Gaits by name: footfalls of the textbooks, amplitudes recalled or by eye."""


def froude(speed_mps: Array | float, hip_m: float) -> Array:
    """Return the Froude number of a speed, for a hip height in metres."""
    return np.asarray(np.square(speed_mps) / (GRAVITY_MPS2 * hip_m), dtype=np.float64)


def stride_m(speed_mps: Array, hip_m: float, species: Species) -> Array:
    """Return the length of a stride, ``k h Fr^e`` in metres, at speeds of any shape."""
    fr = froude(speed_mps, hip_m)
    (factor, power), *fast = species.stride
    if not fast:
        return np.asarray(factor * hip_m * fr**power, dtype=np.float64)
    ((fast_factor, fast_power),), share = fast, smooth_step(fr - 2.0)
    slow_m = hip_m * (factor * fr**power) ** (1.0 - share)
    return np.asarray(slow_m * (fast_factor * fr**fast_power) ** share, dtype=np.float64)


def duty(speed_mps: Array, hip_m: float) -> Array:
    """Return the share of a stride that a foot stands, by symmetric and other gaits (recalled)."""
    fr = np.maximum(froude(speed_mps, hip_m), 1e-6)
    share = smooth_step(fr - 2.0)
    free = (0.52 * fr**-0.14) ** (1.0 - share) * (0.53 * fr**-0.28) ** share
    return np.asarray(np.clip(free, *DUTY), dtype=np.float64)


def draw_going(
    rng: np.random.Generator,
    build: QuadrupedBuild,
    path: Path,
    *,
    style: str,
    footwork: str,
    species: Species,
) -> Action:
    """Draw how an animal goes along a path in a style of `PET_STYLES`; it stands at stops."""
    work, h = FOOTWORK[footwork], build.hip_m
    low = 0.72 if style == "stalk" else STANDING * rng.uniform(0.96, 1.0)
    longer = float(np.exp(np.clip(rng.normal(0.0, 0.06), -0.15, 0.15)))
    lift, ramp = rng.uniform(0.10, 0.20), rng.uniform(0.3, 0.48)
    lh, lf, rh, rf = work.offset
    gait = Gait(
        # Mirrored, right and left change places: the other lead of a canter.
        offset=(rh, rf, lh, lf) if rng.uniform() < 0.5 else work.offset,
        home_m=tuple(zip(0.5 * build.back_m * ENDS, build.half_track_m * SIDES, strict=True)),
        stride_m=lambda v: longer * stride_m(v, h, species),
        duty=lambda v: duty(v, h),
        lift_m=(0.9 * lift * h, lift * h) * 2,
        ramp=ramp,
        ahead_s=0.12,
    )
    # Speed at which the trunk moves as the footwork says, below less, and the duty factor then.
    cruise_mps = max(path.cruise_mps, 0.05)
    share = float(duty(np.array([cruise_mps]), h)[0])
    # A nose at the floor lowers the trunk in front.
    crouch_m, height_m = (0.12 if style == "sniff" else 0.0) * h, low * h
    planned = Feet(path, gait)
    # Each end of the trunk goes up and down by the legs that carry it.
    lh, lf, rh, rf = gait.offset
    ends = (lh, lf) if work.bobs == 2 else (_between(lh, rh), _between(lf, rf))
    sign = 1.0 if work.is_vault else -1.0

    def at(t_s: Array) -> Stance:
        state, strides = path.at(t_s), planned.clock.at(t_s)
        vigour = np.minimum(state.speed_mps / cruise_mps, 1.0)
        rear, front = (
            sign * np.cos(2.0 * np.pi * work.bobs * (strides - first - 0.5 * share))
            for first in ends
        )
        bob = work.bob * h * vigour
        rise = bob * (front - rear) - crouch_m
        sway = work.sway * h * vigour * np.sin(2.0 * np.pi * (strides - lh - 0.5 * share + 0.25))
        cos, sin = np.cos(state.heading_rad), np.sin(state.heading_rad)
        up = height_m + 0.5 * bob * (front + rear) - 0.5 * crouch_m
        return Stance(
            middle_m=np.stack([state.x_m - sway * sin, state.y_m + sway * cos, up], axis=-1),
            heading_rad=state.heading_rad,
            pitch_rad=np.arcsin(np.clip(rise / build.back_m, -0.7, 0.7)),
            paw_m=planned.at(t_s).position_m,
            nod=vigour * front,
            turn_rad_s=state.turn_rad_s,
        )

    return at


def _between(a: float, b: float) -> float:
    """Return the stride phase half-way between two legs' landings, the short way round."""
    return a + 0.5 * ((b - a + 0.5) % 1.0 - 0.5)


# Trunk's middle and hind and fore paws ahead of hip and shoulder, in hip heights; pitch;
# distance of the paws from the middle line, in half tracks; by eye.
_POSTURES = {
    "stand": (STANDING, 0.0, 0.0, 0.0, 1.0),
    "sit": (0.62, 0.32, 0.05, 0.58, 1.1),
    "lie": (0.30, 0.28, 0.05, 0.04, 1.4),
}

_POSTURE_OF = {"pant": "lie", "jump": "stand", "play": "stand", "groom": "sit", "scratch": "sit"}


def _standing(
    rng: np.random.Generator, build: QuadrupedBuild, style: str, path: Path
) -> tuple[Stance, Wander]:
    """Draw the posture, for one time, of an animal where a path begins, facing along it.

    Beside it are offsets of its trunk in x, y, z, in metres, and of its pitch, in radians.
    """
    name = _POSTURE_OF.get(style, style)
    height, hind, fore, pitch, spread = _POSTURES[name]
    h = build.hip_m
    start = path.at(np.array([path.start_s - 1.0]))
    girdle = 0.5 * build.back_m * np.cos(pitch)
    ahead = np.array([-girdle + hind * h, girdle + fore * h] * 2)
    # Paws do not stand quite evenly.
    ahead += 0.04 * h * rng.uniform(-1.0, 1.0, 4)
    left = spread * build.half_track_m * SIDES
    paw = np.column_stack([start.beside(ahead, left), np.zeros(4)])
    middle_z = max(height * h, 0.9 * build.half_depth_m)
    stance = Stance(
        middle_m=np.array([[start.x_m[0], start.y_m[0], middle_z]]),
        heading_rad=start.heading_rad,
        pitch_rad=np.array([pitch]),
        paw_m=paw[None],
    )
    size = {"stand": 0.02, "sit": 0.006, "lie": 0.0005}[name] * h
    restless = 4.0 if style in {"groom", "scratch"} else 1.0
    limits = restless * np.array([size, size, 0.2 * size, size / build.back_m])
    return stance, Wander(rng, limits, 0.8 * restless * limits)


def draw_staying(
    rng: np.random.Generator, build: QuadrupedBuild, style: str, path: Path
) -> Action:
    """Draw an animal that stays in a place; its trunk sways a little over still paws."""
    s, sways = _standing(rng, build, style, path)
    scratch = _draw_scratch(rng, build.hip_m) if style == "scratch" else None

    def at(t_s: Array) -> Stance:
        sway = sways.at(t_s)
        heading = np.zeros(len(t_s)) + s.heading_rad
        paw = np.repeat(s.paw_m, len(t_s), axis=0)
        if scratch:
            leg, paw_at = scratch
            ahead, up = paw_at(t_s)
            paw[:, leg] += np.stack([ahead * np.cos(heading), ahead * np.sin(heading), up], -1)
        return Stance(
            middle_m=s.middle_m + sway[:, :3],
            heading_rad=heading,
            pitch_rad=s.pitch_rad + sway[:, 3],
            paw_m=paw,
        )

    return at


def _draw_scratch(
    rng: np.random.Generator, h: float
) -> tuple[int, Callable[[Array], tuple[Array, Array]]]:
    """Draw which hind paw scratches, in bouts, and how far ahead and up it is by time, in metres.

    Dogs make 4 to 8 strokes a second (recalled).
    """
    u = rng.random(4)
    ahead, up, stroke_m = -0.05 * h, (0.10 + 0.08 * u[1]) * h, (0.05 + 0.05 * u[2]) * h
    hz, bout = float(8.0 - 4.0 * u[3]), Wander(rng, [1.0], [0.5])

    def at(t_s: Array) -> tuple[Array, Array]:
        share, stroke = bouts(bout, t_s), stroke_m * np.sin(2.0 * np.pi * hz * t_s)
        return share * (ahead + stroke), share * (up + 0.5 * stroke)

    return LEGS.index("left hind" if u[0] < 0.5 else "right hind"), at


def draw_romping(rng: np.random.Generator, build: QuadrupedBuild, path: Path) -> Action:
    """Draw one that turns, hops, bows, shakes itself at 4 to 5 Hz (Dickerson 2012, recalled)."""
    s, _ = _standing(rng, build, "play", path)
    u, h, lively = rng.random(6), build.hip_m, float(np.exp(rng.uniform(-0.7, 0.7)))
    limits = (0.6 * h, 0.6 * h, 2.0, 0.12)
    # Of the trunk: x and y, in metres, heading and pitch, in radians.
    wander = Wander(rng, limits, lively * np.array([0.5 * h, 0.5 * h, 0.9, 0.25]))
    step_hz, lift_m = float(1.0 + 2.0 * u[0]), float(0.08 + 0.22 * u[1]) * h  # of each paw
    # When each paw steps, in steps: diagonal paws nearly together.
    offset = (0.0, 0.5 + 0.2 * u[2], 0.5, 0.2 * u[2])
    bounce_m = float(0.01 + 0.06 * u[3]) * h  # of the trunk, twice a step
    bow_rad, shake_m = float(0.3 + 0.3 * u[4]), float(0.01 + 0.015 * u[5]) * h
    shake_hz = float(np.clip(9.4 * build.mass_kg**-0.22, 3.5, 8.0))
    # It bows and shakes itself where its number, -1 to 1, is above 0.4.
    bout_of_each = Wander(rng, [1.0, 1.0], [0.5, 0.5])
    home = s.paw_m[0] - s.middle_m[0]

    def under(leg: int, t_s: Array) -> Array:
        w = wander.at(t_s)
        cos, sin = np.cos(w[:, 2]), np.sin(w[:, 2])
        x, y = s.middle_m[0, 0] + w[:, 0], s.middle_m[0, 1] + w[:, 1]
        ahead, left, _ = home[leg]
        x, y = x + cos * ahead - sin * left, y + sin * ahead + cos * left
        return np.stack([x, y, 0.0 * x], axis=-1)

    def paw(leg: int, t_s: Array) -> Array:
        """Return where a paw is, shape (n_slow, 3): it steps to where the trunk will be."""
        steps = t_s * step_hz + offset[leg]
        number = np.floor(steps)
        # The second half of a step is a swing.
        swing = np.clip(2.0 * (steps - number) - 1.0, 0.0, 1.0)
        here, there = (under(leg, (number + k - offset[leg]) / step_hz) for k in (0.25, 1.25))
        place = here + smooth_step(swing)[:, None] * (there - here)
        place[:, 2] += lift_m * np.sin(np.pi * swing) ** 2
        return place

    def at(t_s: Array) -> Stance:
        w = wander.at(t_s)
        bows, shakes = smooth_step((bout_of_each.at(t_s) - 0.2) / 0.4).T
        turn = 2.0 * np.pi * t_s
        heading = s.heading_rad + w[:, 2]
        shake = shakes * shake_m * np.sin(shake_hz * turn)
        bounce = (1.0 - shakes) * bounce_m * np.cos(2.0 * step_hz * turn)
        bow = bows * bow_rad
        x, y = w[:, 0] - shake * np.sin(heading), w[:, 1] + shake * np.cos(heading)
        down = float(np.hypot(*home[1, :2])) * 0.5 * np.sin(bow)
        return Stance(
            middle_m=s.middle_m + np.stack([x, y, bounce - down], axis=-1),
            heading_rad=heading,
            pitch_rad=s.pitch_rad + w[:, 3] - bow,
            paw_m=np.stack([paw(k, t_s) for k in range(4)], axis=1),
        )

    return at


# By eye: crouch before, push of the legs and yield at the landing, in hip heights; how
# far a paw clears what it jumps onto; how quickly legs fold; how long it then takes to stand.
_CROUCH, _PUSH, _LANDING = 0.3, 0.9, 0.4
_CLEAR_M, _TUCK_S, _RISE_S = 0.08, 0.3, 0.6


class Leap:
    """One jump from rest to rest, as seen from where it begins, along the heading and up.

    It goes `climb_m` up (negative: down) and `ahead_m` ahead in the air.
    """

    def __init__(
        self, begin_s: float, climb_m: float, ahead_m: float, hip_m: float, crouch_s: float
    ) -> None:
        # The trunk leaves at 0.6 hip heights over standing and touches down at 0.
        rise = max(climb_m - 0.6 * hip_m, 0.0) + _CLEAR_M
        up = float(np.sqrt(2.0 * GRAVITY_MPS2 * rise))
        down = float(np.sqrt(2.0 * GRAVITY_MPS2 * (0.6 * hip_m + rise - climb_m)))
        flight = (up + down) / GRAVITY_MPS2
        self.begin_s, self.climb_m, self.hip_m = begin_s, climb_m, hip_m
        self.leave_s = begin_s + crouch_s  # when the push begins; fore feet leave the floor
        self.take_off_s = self.leave_s + 2.0 * _PUSH * hip_m / up  # the hind feet do
        self.touch_down_s = self.take_off_s + flight  # when the fore feet land
        self.still_s = self.touch_down_s + 2.0 * _LANDING * hip_m / down  # the trunk goes no more
        self.end_s = self.still_s + _RISE_S  # when the body stands again
        self.push_s = self.take_off_s - self.leave_s
        self.flight_s = self.touch_down_s - self.take_off_s
        self.landing_s = self.still_s - self.touch_down_s
        # Ahead and up at take-off, and up at touch-down.
        self.velocity_mps, self.landing_mps = (ahead_m / flight, up), -down
        way_s = 0.5 * self.push_s + self.flight_s + 0.5 * self.landing_s
        self.ahead_m = self.velocity_mps[0] * way_s  # from push to standstill

    def trunk(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return how far the trunk's middle is ahead and up, and its pitch, from standing."""
        push_s, flight_s, landing_s = self.push_s, self.flight_s, self.landing_s
        push = np.clip(t_s - self.leave_s, 0.0, push_s)
        air = np.clip(t_s - self.take_off_s, 0.0, flight_s)
        land = np.clip(t_s - self.touch_down_s, 0.0, landing_s)
        # Way at constant acceleration from rest, in seconds at the full speed; and to rest.
        pushed = push * push / (2.0 * push_s)
        landed = land - land * land / (2.0 * landing_s)
        vx, vz = self.velocity_mps
        ahead = vx * (pushed + air + landed)
        down = smooth_step((t_s - self.begin_s) / (self.leave_s - self.begin_s))
        again = smooth_step((t_s - self.still_s) / _RISE_S)
        up = (vz * (pushed + air) - 0.5 * GRAVITY_MPS2 * air * air) + self.landing_mps * landed
        up += self.hip_m * (-_CROUCH * down + _LANDING * again)
        tip = smooth_step((t_s - self.leave_s) / push_s)
        over = smooth_step((t_s - self.take_off_s) / flight_s)
        level = smooth_step((t_s - self.touch_down_s - 0.3 * landing_s) / _RISE_S)
        climb = 0.9 if self.climb_m > 0 else 0.1
        pitch = 0.15 * down + climb * tip - (climb + 0.45) * over + 0.3 * level
        return ahead, up, pitch

    def paw_share(self, t_s: Array, *, is_fore: bool) -> tuple[Array, Array]:
        """Return how much a paw is off the floor it left, and on the floor it comes to."""
        leaves = self.leave_s if is_fore else self.take_off_s
        lands = self.touch_down_s if is_fore else 0.5 * (self.touch_down_s + self.still_s)
        quick = min(_TUCK_S, 0.45 * (lands - leaves))
        off = smooth_step((t_s - leaves) / quick)
        return off, smooth_step((t_s - lands) / quick + 1.0)


def draw_jumping(
    rng: np.random.Generator, build: QuadrupedBuild, path: Path, species: Species
) -> tuple[Action, float]:
    """Draw one that jumps onto something, stays, and jumps down on its other side.

    It goes all ahead, and stands in between; beside it is when it stands for good, in seconds.
    """
    standing = draw_staying(rng, build, "jump", path)
    h = build.hip_m
    climb = float(np.clip(h * rng.uniform(*species.jump), 0.2, 0.9))
    crouch = rng.uniform(0.3, 0.7, 2)
    up = Leap(rng.uniform(0.8, 2.0), climb, h * rng.uniform(1.2, 2.2), h, crouch[0])
    stays = rng.uniform(1.5, 6.0)
    down = Leap(up.end_s + stays, -climb, h * rng.uniform(1.5, 2.5), h, crouch[1])

    def at(t_s: Array) -> Stance:
        s = standing(t_s)
        ahead = direction(s.heading_rad)
        middle, pitch, paw = s.middle_m, s.pitch_rad, s.paw_m
        for leap in (up, down):
            way, height, tip = leap.trunk(t_s)
            middle = middle + way[:, None] * ahead + height[:, None] * UP
            pitch = pitch + tip
        # Where paws are in the air: under hip and shoulder, legs half bent.
        long = np.cos(pitch)[:, None] * ahead + np.sin(pitch)[:, None] * UP
        left = np.cross(UP, ahead)
        tucked = (
            middle[:, None]
            + (0.5 * ENDS * build.back_m)[:, None] * long[:, None]
            + (SIDES * build.half_track_m)[:, None] * left[:, None]
            + 0.15 * h * ENDS[:, None] * ahead[:, None]
            - 0.62 * h * UP
        )
        for leap in (up, down):
            end = paw + (leap.ahead_m * ahead + leap.climb_m * UP)[:, None]
            shares = (leap.paw_share(t_s, is_fore=bool(k % 2)) for k in range(4))
            off, on = (np.stack(x, axis=1)[..., None] for x in zip(*shares, strict=True))
            paw = paw * (1.0 - off) + off * ((1.0 - on) * tucked + on * end)
        return replace(s, middle_m=middle, pitch_rad=pitch, paw_m=paw)

    return at, down.end_s
