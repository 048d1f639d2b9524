"""Four-legged animals that stay in one place: stand, sit, lie, pant, groom, scratch, play."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.hung import Stance
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.quadrupeds import LEGS, SIDES, QuadrupedBuild
from x2radar.sim.bodies.wander import Wander, bouts, smooth_step
from x2radar.sim.points import Array

STANDING = 0.97  # height of a standing trunk's middle, in hip heights: legs are a little bent

# Trunk's middle and hind and fore paws ahead of hip and shoulder, in hip heights; pitch;
# distance of the paws from the middle line, in half tracks; by eye.
_POSTURES = {
    "stand": (STANDING, 0.0, 0.0, 0.0, 1.0),
    "sit": (0.62, 0.32, 0.05, 0.58, 1.1),
    "lie": (0.30, 0.28, 0.05, 0.04, 1.4),
}

_POSTURE_OF = {"pant": "lie", "jump": "stand", "play": "stand", "groom": "sit", "scratch": "sit"}


@dataclass(frozen=True, slots=True, eq=False)
class Scratch:
    """A hind paw that scratches, in bouts."""

    leg: int  # which, of `LEGS`
    raised_m: tuple[float, float]  # how far ahead and up the paw is held
    stroke_m: float  # amplitude of the strokes
    hz: float  # their frequency
    bout: Wander  # one number in -1 to 1; it scratches where that is above 0

    def at(self, t_s: Array) -> tuple[Array, Array]:
        """Return how far ahead and up the paw is, in metres, each of shape (n_slow,)."""
        share = bouts(self.bout, t_s)
        stroke = self.stroke_m * np.sin(2.0 * np.pi * self.hz * t_s)
        ahead, up = self.raised_m
        return share * (ahead + stroke), share * (up + 0.5 * stroke)


@dataclass(frozen=True, slots=True, eq=False)
class Staying:
    """Standing, sitting or lying in one place; the trunk sways a little over still paws."""

    stance: Stance  # the posture, for one time
    sway: Wander  # offsets of the trunk in x, y, z, in metres, and of its pitch, in radians
    scratch: Scratch | None = None  # what a hind paw does

    def at(self, t_s: Array) -> Stance:
        s, n = self.stance, len(t_s)
        sway = self.sway.at(t_s)
        heading = np.zeros(n) + s.heading_rad
        paw = np.repeat(s.paw_m, n, axis=0)
        if self.scratch:
            ahead, up = self.scratch.at(t_s)
            paw[:, self.scratch.leg] += np.stack(
                [ahead * np.cos(heading), ahead * np.sin(heading), up], axis=-1
            )
        return Stance(
            middle_m=s.middle_m + sway[:, :3],
            heading_rad=heading,
            pitch_rad=s.pitch_rad + sway[:, 3],
            paw_m=paw,
        )


def draw_staying(
    rng: np.random.Generator, build: QuadrupedBuild, style: str, path: Path
) -> Staying:
    """Draw an animal that stays where a path begins, facing along it."""
    name = _POSTURE_OF.get(style, style)
    height, hind, fore, pitch, spread = _POSTURES[name]
    h = build.hip_m
    start = path.at(np.array([path.start_s - 1.0]))
    cos, sin = np.cos(start.heading_rad[0]), np.sin(start.heading_rad[0])
    girdle = 0.5 * build.back_m * np.cos(pitch)
    ahead = np.array([-girdle + hind * h, girdle + fore * h] * 2)
    # Paws do not stand quite evenly.
    ahead += 0.04 * h * rng.uniform(-1.0, 1.0, 4)
    left = spread * build.half_track_m * SIDES
    paw = np.stack(
        [start.x_m + ahead * cos - left * sin, start.y_m + ahead * sin + left * cos, np.zeros(4)],
        axis=-1,
    )
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
    sway = Wander.draw(rng, limits, 0.8 * restless * limits)
    return Staying(stance, sway, _scratch(rng, build) if style == "scratch" else None)


def _scratch(rng: np.random.Generator, build: QuadrupedBuild) -> Scratch:
    """Draw how a hind paw scratches: 4 to 8 strokes a second (recalled, of dogs)."""
    u, h = rng.random(4), build.hip_m
    return Scratch(
        leg=LEGS.index("left hind" if u[0] < 0.5 else "right hind"),
        raised_m=(-0.05 * h, (0.10 + 0.08 * u[1]) * h),
        stroke_m=(0.05 + 0.05 * u[2]) * h,
        hz=float(8.0 - 4.0 * u[3]),
        bout=Wander.draw(rng, [1.0], [0.5]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Romping:
    """Playing on the spot: turning, hopping from foot to foot, bowing, shaking itself."""

    stance: Stance  # where it stands at first, for one time
    wander: Wander  # of the trunk: x and y, in metres, heading and pitch, in radians
    step_hz: float  # how often each paw steps
    lift_m: float  # and how high
    offset: tuple[float, ...]  # when each paw steps, in steps
    bounce_m: float  # amplitude of the trunk's bounce, twice a step
    bow_rad: float  # how far the front goes down where it bows
    shake_m: float  # amplitude of the trunk where it shakes itself
    shake_hz: float  # and frequency
    bout: Wander  # bowing, shaking: each happens where its number, -1 to 1, is above 0.4

    @classmethod
    def draw(cls, rng: np.random.Generator, build: QuadrupedBuild, path: Path) -> Self:
        """Draw an animal that plays, and shakes at 4 to 5 Hz (Dickerson et al. 2012, recalled)."""
        standing = draw_staying(rng, build, "play", path)
        u, h, lively = rng.random(6), build.hip_m, float(np.exp(rng.uniform(-0.7, 0.7)))
        limits = (0.6 * h, 0.6 * h, 2.0, 0.12)
        return cls(
            stance=standing.stance,
            wander=Wander.draw(rng, limits, lively * np.array([0.5 * h, 0.5 * h, 0.9, 0.25])),
            step_hz=float(1.0 + 2.0 * u[0]),
            lift_m=float(0.08 + 0.22 * u[1]) * h,
            # Diagonal paws nearly together.
            offset=(0.0, 0.5 + 0.2 * u[2], 0.5, 0.2 * u[2]),
            bounce_m=float(0.01 + 0.06 * u[3]) * h,
            bow_rad=float(0.3 + 0.3 * u[4]),
            shake_m=float(0.01 + 0.015 * u[5]) * h,
            shake_hz=float(np.clip(9.4 * build.mass_kg**-0.22, 3.5, 8.0)),
            bout=Wander.draw(rng, [1.0, 1.0], [0.5, 0.5]),
        )

    def at(self, t_s: Array) -> Stance:
        s = self.stance
        w, bout = self.wander.at(t_s), self.bout.at(t_s)
        bows, shakes = smooth_step((bout - 0.2) / 0.4).T
        turn = 2.0 * np.pi * t_s
        heading = s.heading_rad + w[:, 2]
        shake = shakes * self.shake_m * np.sin(self.shake_hz * turn)
        bounce = (1.0 - shakes) * self.bounce_m * np.cos(2.0 * self.step_hz * turn)
        bow = bows * self.bow_rad
        girdle = float(np.hypot(*(s.paw_m[0, 1] - s.middle_m[0])[:2]))
        middle = s.middle_m + np.stack(
            [
                w[:, 0] - shake * np.sin(heading),
                w[:, 1] + shake * np.cos(heading),
                bounce - girdle * 0.5 * np.sin(bow),
            ],
            axis=-1,
        )
        return Stance(
            middle_m=middle,
            heading_rad=heading,
            pitch_rad=s.pitch_rad + w[:, 3] - bow,
            paw_m=np.stack([self._paw(k, t_s) for k in range(4)], axis=1),
        )

    def _paw(self, leg: int, t_s: Array) -> Array:
        """Return where a paw is, shape (n_slow, 3): it steps to where the trunk will be."""
        steps = t_s * self.step_hz + self.offset[leg]
        number = np.floor(steps)
        # The second half of a step is a swing.
        swing = np.clip(2.0 * (steps - number) - 1.0, 0.0, 1.0)
        here, there = (
            self._under(leg, (number + k - self.offset[leg]) / self.step_hz) for k in (0.25, 1.25)
        )
        place = here + smooth_step(swing)[:, None] * (there - here)
        place[:, 2] += self.lift_m * np.sin(np.pi * swing) ** 2
        return place

    def _under(self, leg: int, t_s: Array) -> Array:
        s, w = self.stance, self.wander.at(t_s)
        home = s.paw_m[0, leg] - s.middle_m[0]
        cos, sin = np.cos(w[:, 2]), np.sin(w[:, 2])
        x, y = s.middle_m[0, 0] + w[:, 0], s.middle_m[0, 1] + w[:, 1]
        return np.stack(
            [x + cos * home[0] - sin * home[1], y + sin * home[0] + cos * home[1], 0.0 * x],
            axis=-1,
        )
