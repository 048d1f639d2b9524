"""Four-legged animals that stay in one place: stand, sit, lie, pant, groom, scratch, play."""

from collections.abc import Callable

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.hung import Action, Stance
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
    return stance, Wander.draw(rng, limits, 0.8 * restless * limits)


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
    hz, bout = float(8.0 - 4.0 * u[3]), Wander.draw(rng, [1.0], [0.5])

    def at(t_s: Array) -> tuple[Array, Array]:
        share, stroke = bouts(bout, t_s), stroke_m * np.sin(2.0 * np.pi * hz * t_s)
        return share * (ahead + stroke), share * (up + 0.5 * stroke)

    return LEGS.index("left hind" if u[0] < 0.5 else "right hind"), at


def draw_romping(rng: np.random.Generator, build: QuadrupedBuild, path: Path) -> Action:
    """Draw an animal that plays on the spot: turns, hops, bows, and shakes itself.

    It shakes at 4 to 5 Hz (Dickerson et al. 2012, recalled).
    """
    s, _ = _standing(rng, build, "play", path)
    u, h, lively = rng.random(6), build.hip_m, float(np.exp(rng.uniform(-0.7, 0.7)))
    limits = (0.6 * h, 0.6 * h, 2.0, 0.12)
    # Of the trunk: x and y, in metres, heading and pitch, in radians.
    wander = Wander.draw(rng, limits, lively * np.array([0.5 * h, 0.5 * h, 0.9, 0.25]))
    step_hz, lift_m = float(1.0 + 2.0 * u[0]), float(0.08 + 0.22 * u[1]) * h  # of each paw
    # When each paw steps, in steps: diagonal paws nearly together.
    offset = (0.0, 0.5 + 0.2 * u[2], 0.5, 0.2 * u[2])
    bounce_m = float(0.01 + 0.06 * u[3]) * h  # of the trunk, twice a step
    bow_rad, shake_m = float(0.3 + 0.3 * u[4]), float(0.01 + 0.015 * u[5]) * h
    shake_hz = float(np.clip(9.4 * build.mass_kg**-0.22, 3.5, 8.0))
    # It bows and shakes itself where its number, -1 to 1, is above 0.4.
    bout_of_each = Wander.draw(rng, [1.0, 1.0], [0.5, 0.5])
    home = s.paw_m[0] - s.middle_m[0]

    def under(leg: int, t_s: Array) -> Array:
        w = wander.at(t_s)
        cos, sin = np.cos(w[:, 2]), np.sin(w[:, 2])
        x, y = s.middle_m[0, 0] + w[:, 0], s.middle_m[0, 1] + w[:, 1]
        ahead, left, _ = home[leg]
        return np.stack(
            [x + cos * ahead - sin * left, y + sin * ahead + cos * left, 0.0 * x], axis=-1
        )

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
