"""Four-legged animals that stay in one place: stand, sit, lie, pant, groom, scratch."""

from dataclasses import dataclass

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.hung import Stance
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.quadrupeds import LEGS, SIDES, QuadrupedBuild
from x2radar.sim.bodies.wander import Wander, bouts
from x2radar.sim.points import Array

STANDING = 0.97
"""Height of a standing trunk's middle, in hip heights: legs are a little bent."""

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
        """Return where trunk and paws are; see `Action`."""
        s, n = self.stance, len(t_s)
        sway = self.sway.at(t_s)
        still = np.zeros(n)
        heading = still + s.heading_rad
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
            nod=still,
            turn_rad_s=still,
        )


def draw_staying(
    rng: np.random.Generator, build: QuadrupedBuild, style: str, path: Path
) -> Staying:
    """Draw an animal that stays where a path begins, facing along it.

    One that pants lies, one that grooms or scratches sits, one that jumps or plays stands
    first.
    """
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
        [
            start.x_m + ahead * cos - left * sin,
            start.y_m + ahead * sin + left * cos,
            np.zeros(4),
        ],
        axis=-1,
    )
    middle_z = max(height * h, 0.9 * build.half_depth_m)
    stance = Stance(
        middle_m=np.array([[start.x_m[0], start.y_m[0], middle_z]]),
        heading_rad=start.heading_rad,
        pitch_rad=np.array([pitch]),
        paw_m=paw[None],
        nod=np.zeros(1),
        turn_rad_s=np.zeros(1),
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
