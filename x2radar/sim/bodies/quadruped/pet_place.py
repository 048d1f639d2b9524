"""Postures of animals that stay in one place, or jump."""

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.quadruped.actions import Romping, Scratch, Staying
from x2radar.sim.bodies.quadruped.build import QuadrupedBuild
from x2radar.sim.bodies.quadruped.gait import LEGS
from x2radar.sim.bodies.quadruped.jump import Jumping, Leap
from x2radar.sim.bodies.quadruped.quadruped import Stance
from x2radar.sim.bodies.quadruped.species import Species

Array = NDArray[np.float64]

STANDING = 0.97
"""Height of a standing trunk's middle, in hip heights: legs are a little bent (chosen)."""

# Trunk's middle and hind and fore paws ahead of hip and shoulder, in hip heights; pitch;
# distance of the paws from the middle line, in half tracks. Chosen by eye.
_POSTURES = {
    "stand": (STANDING, 0.0, 0.0, 0.0, 1.0),
    "sit": (0.62, 0.32, 0.05, 0.58, 1.1),
    "lie": (0.30, 0.28, 0.05, 0.04, 1.4),
}

_POSTURE_OF = {
    "pant": "lie",
    "jump": "stand",
    "play": "stand",
    "groom": "sit",
    "scratch": "sit",
}


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
    left = spread * build.half_track_m * np.array([1.0, 1.0, -1.0, -1.0])
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
        bout=Wander.draw(rng, np.ones(1), np.full(1, 0.5)),
    )


def draw_playing(rng: np.random.Generator, build: QuadrupedBuild, path: Path) -> Romping:
    """Draw an animal that plays where a path begins.

    How fast it turns and hops is a guess; it shakes itself 4 to 5 times a second, small ones
    faster (Dickerson et al. 2012, recalled: the frequency goes with mass to the power -0.22).
    """
    standing = draw_staying(rng, build, "play", path)
    u, h, lively = rng.random(6), build.hip_m, float(np.exp(rng.uniform(-0.7, 0.7)))
    limits = np.array([0.6 * h, 0.6 * h, 2.0, 0.12])
    return Romping(
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
        bout=Wander.draw(rng, np.ones(2), np.full(2, 0.5)),
    )


def draw_jumping(
    rng: np.random.Generator, build: QuadrupedBuild, path: Path, species: Species
) -> tuple[Jumping, float]:
    """Draw one that jumps onto something, stays, and jumps down on its other side.

    It stands where the path begins, and jumps along it. Also returns when it stands on the
    floor again, in seconds.
    """
    standing = draw_staying(rng, build, "jump", path)
    h = build.hip_m
    climb = float(np.clip(h * rng.uniform(*species.jump), 0.2, 0.9))
    crouch = rng.uniform(0.3, 0.7, 2)
    up = Leap.over(rng.uniform(0.8, 2.0), climb, h * rng.uniform(1.2, 2.2), h, crouch[0])
    stays = rng.uniform(1.5, 6.0)
    down = Leap.over(
        up.still_s + up.rise_s + stays, -climb, h * rng.uniform(1.5, 2.5), h, crouch[1]
    )
    return Jumping(standing, build, (up, down)), down.still_s + down.rise_s
