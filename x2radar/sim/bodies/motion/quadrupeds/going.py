"""Four-legged animals that go along a path: walk, trot, pace, canter, bound."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.gait import Footwork
from x2radar.sim.bodies.motion.quadrupeds.hung import Stance
from x2radar.sim.bodies.path.feet import Feet, Gait
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.quadrupeds import QuadrupedBuild
from x2radar.sim.points import Array


@dataclass(frozen=True, slots=True, eq=False)
class Going:
    """Walking, trotting, cantering along a path, standing where it stops."""

    path: Path  # where the middle of the trunk goes
    feet: Feet  # footfalls along it
    footwork: Footwork  # what the trunk does
    offset: tuple[float, ...]  # when each leg lands, in strides
    build: QuadrupedBuild  # sizes
    height_m: float  # height of the trunk's middle, standing
    cruise_mps: float  # speed at which the trunk moves as the footwork says; below, less
    duty: float  # duty factor at that speed
    crouch: float  # how much lower the trunk is in front, in hip heights: a nose at the floor

    @classmethod
    def plan(
        cls,
        path: Path,
        gait: Gait,
        footwork: Footwork,
        build: QuadrupedBuild,
        *,
        height_m: float,
        crouch: float = 0.0,
    ) -> Self:
        """Return the going of an animal along a path; see the fields."""
        cruise = max(path.cruise_mps, 0.05)
        duty = float(gait.duty(np.array([cruise]))[0])
        feet = Feet.plan(path, gait)
        return cls(path, feet, footwork, gait.offset, build, height_m, cruise, duty, crouch)

    def at(self, t_s: Array) -> Stance:
        """Return where trunk and paws are; see `Action`."""
        f, h = self.footwork, self.build.hip_m
        state = self.path.at(t_s)
        feet = self.feet.at(t_s)
        strides = self.feet.clock.at(t_s)
        vigour = np.minimum(state.speed_mps / self.cruise_mps, 1.0)
        # Each end of the trunk goes up and down by the legs that carry it.
        lh, lf, rh, rf = self.offset
        hind, fore = (lh, lf) if f.bobs == 2 else (_between(lh, rh), _between(lf, rf))
        sign = 1.0 if f.is_vault else -1.0
        rear, front = (
            sign * np.cos(2.0 * np.pi * f.bobs * (strides - first - 0.5 * self.duty))
            for first in (hind, fore)
        )
        bob = f.bob * h * vigour
        low = self.crouch * h
        rise = bob * (front - rear) - low
        sway = f.sway * h * vigour * np.sin(2.0 * np.pi * (strides - lh - 0.5 * self.duty + 0.25))
        cos, sin = np.cos(state.heading_rad), np.sin(state.heading_rad)
        middle = np.stack(
            [
                state.x_m - sway * sin,
                state.y_m + sway * cos,
                self.height_m + 0.5 * bob * (front + rear) - 0.5 * low,
            ],
            axis=-1,
        )
        return Stance(
            middle_m=middle,
            heading_rad=state.heading_rad,
            pitch_rad=np.arcsin(np.clip(rise / self.build.back_m, -0.7, 0.7)),
            paw_m=feet.position_m,
            nod=vigour * front,
            turn_rad_s=state.turn_rad_s,
        )


def _between(a: float, b: float) -> float:
    """Return the stride phase half-way between two legs' landings, the short way round."""
    return a + 0.5 * ((b - a + 0.5) % 1.0 - 0.5)
