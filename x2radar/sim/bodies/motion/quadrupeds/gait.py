"""How four-legged animals put their feet, and what their trunk does over them.

Speed is measured by the Froude number ``Fr = v^2 / (g h)``, h the height of the hip; animals
of any size move alike at equal Froude numbers (Alexander and Jayes, A dynamic similarity
hypothesis for the gaits of quadrupedal mammals, 1983; coefficients recalled).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.hung import Action, Stance
from x2radar.sim.bodies.motion.quadrupeds.staying import GRAVITY_MPS2, STANDING
from x2radar.sim.bodies.path.feet import Feet, Gait
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.quadrupeds import ENDS, SIDES, QuadrupedBuild
from x2radar.sim.bodies.skeleton.species import Species
from x2radar.sim.bodies.wander import smooth_step
from x2radar.sim.points import Array

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
    return np.asarray(
        hip_m * (factor * fr**power) ** (1.0 - share) * (fast_factor * fr**fast_power) ** share,
        dtype=np.float64,
    )


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
    """Draw how an animal walks, trots or canters along a path in a style of `PET_STYLES`.

    It stands where it stops.
    """
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
