"""Four-legged animals that jump onto furniture and down again."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.gait import GRAVITY_MPS2
from x2radar.sim.bodies.motion.quadrupeds.hung import Action, Stance
from x2radar.sim.bodies.motion.quadrupeds.staying import draw_staying
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.quadrupeds import ENDS, SIDES, QuadrupedBuild
from x2radar.sim.bodies.skeleton.skeleton import direction
from x2radar.sim.bodies.skeleton.species import Species
from x2radar.sim.bodies.wander import smooth_step
from x2radar.sim.points import UP, Array

# By eye: crouch before, push of the legs and yield at the landing, in hip heights; how
# far a paw clears what it jumps onto; how quickly legs fold; how long it then takes to stand.
_CROUCH, _PUSH, _LANDING = 0.3, 0.9, 0.4
_CLEAR_M, _TUCK_S, _RISE_S = 0.08, 0.3, 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Leap:
    """One jump from rest to rest, as seen from where it begins, along the heading and up."""

    begin_s: float  # when the crouch begins
    leave_s: float  # when the push begins; the fore feet leave the floor
    take_off_s: float  # when the hind feet leave the floor
    touch_down_s: float  # when the fore feet land
    still_s: float  # when the trunk stops going ahead
    velocity_mps: tuple[float, float]  # ahead and up at take-off
    landing_mps: float  # upward velocity at touch-down, negative
    climb_m: float  # height of where it lands over where it begins
    hip_m: float  # hip height

    @classmethod
    def over(
        cls, begin_s: float, climb_m: float, ahead_m: float, hip_m: float, crouch_s: float
    ) -> Self:
        """Return a jump `climb_m` up (negative: down) that goes `ahead_m` in the air."""
        # The trunk leaves at 0.6 hip heights over standing and touches down at 0.
        rise = max(climb_m - 0.6 * hip_m, 0.0) + _CLEAR_M
        up = float(np.sqrt(2.0 * GRAVITY_MPS2 * rise))
        down = float(np.sqrt(2.0 * GRAVITY_MPS2 * (0.6 * hip_m + rise - climb_m)))
        flight = (up + down) / GRAVITY_MPS2
        leave = begin_s + crouch_s
        take_off = leave + 2.0 * _PUSH * hip_m / up
        touch_down = take_off + flight
        still = touch_down + 2.0 * _LANDING * hip_m / down
        velocity = (ahead_m / flight, up)
        return cls(begin_s, leave, take_off, touch_down, still, velocity, -down, climb_m, hip_m)

    @property
    def end_s(self) -> float:
        """When the body stands again, in seconds."""
        return self.still_s + _RISE_S

    @property
    def ahead_m(self) -> float:
        """How far the body gets from push to standstill, in metres."""
        push, flight, landing = self._parts_s
        return self.velocity_mps[0] * (0.5 * push + flight + 0.5 * landing)

    @property
    def _parts_s(self) -> tuple[float, float, float]:
        """How long push, flight and landing take."""
        return (
            self.take_off_s - self.leave_s,
            self.touch_down_s - self.take_off_s,
            self.still_s - self.touch_down_s,
        )

    def trunk(self, t_s: Array) -> tuple[Array, Array, Array]:
        """Return how far the trunk's middle is ahead and up, and its pitch, from standing."""
        push_s, flight_s, landing_s = self._parts_s
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
    up = Leap.over(rng.uniform(0.8, 2.0), climb, h * rng.uniform(1.2, 2.2), h, crouch[0])
    stays = rng.uniform(1.5, 6.0)
    down = Leap.over(up.end_s + stays, -climb, h * rng.uniform(1.5, 2.5), h, crouch[1])

    def at(t_s: Array) -> Stance:
        s = standing(t_s)
        ahead = direction(s.heading_rad)
        middle, pitch, paw = s.middle_m, s.pitch_rad, s.paw_m
        for leap in (up, down):
            way, height, tip = leap.trunk(t_s)
            middle = middle + way[:, None] * ahead + height[:, None] * UP
            pitch = pitch + tip
        for leap in (up, down):
            end = paw + (leap.ahead_m * ahead + leap.climb_m * UP)[:, None]
            shares = (leap.paw_share(t_s, is_fore=bool(k % 2)) for k in range(4))
            off, on = (np.stack(x, axis=1)[..., None] for x in zip(*shares, strict=True))
            tucked = _tucked(build, middle, pitch, ahead)
            paw = paw * (1.0 - off) + off * ((1.0 - on) * tucked + on * end)
        return replace(s, middle_m=middle, pitch_rad=pitch, paw_m=paw)

    return at, down.end_s


def _tucked(b: QuadrupedBuild, middle: Array, pitch: Array, ahead: Array) -> Array:
    """Return where paws are in the air: under hip and shoulder, legs half bent."""
    long = np.cos(pitch)[:, None] * ahead + np.sin(pitch)[:, None] * UP
    left = np.cross(UP, ahead)
    return np.asarray(
        middle[:, None]
        + (0.5 * ENDS * b.back_m)[:, None] * long[:, None]
        + (SIDES * b.half_track_m)[:, None] * left[:, None]
        + 0.15 * b.hip_m * ENDS[:, None] * ahead[:, None]
        - 0.62 * b.hip_m * UP,
        dtype=np.float64,
    )
