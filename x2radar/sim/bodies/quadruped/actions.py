"""What four-legged animals do on the floor: go along a path, or stay in a posture."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import Wander, smooth_step
from x2radar.sim.bodies.path.feet import Feet, Gait
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.quadruped.build import QuadrupedBuild
from x2radar.sim.bodies.quadruped.gait import Footwork
from x2radar.sim.bodies.quadruped.quadruped import Stance

Array = NDArray[np.float64]


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
        cruise = max(float(path.pieces[2].max()), 0.05)
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
        share = smooth_step(self.bout.at(t_s)[:, 0] / 0.4 + 0.5)
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

    def at(self, t_s: Array) -> Stance:
        """Return where trunk and paws are; see `Action`."""
        s, n = self.stance, len(t_s)
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
            nod=np.zeros(n),
            turn_rad_s=np.zeros(n),
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


def _between(a: float, b: float) -> float:
    """Return the stride phase half-way between two legs' landings, the short way round."""
    return a + 0.5 * ((b - a + 0.5) % 1.0 - 0.5)
