"""Four-legged animals that play on the spot: turning, hopping, bowing, shaking themselves."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.motion.quadrupeds.hung import Stance
from x2radar.sim.bodies.motion.quadrupeds.staying import draw_staying
from x2radar.sim.bodies.path.path import Path
from x2radar.sim.bodies.skeleton.quadrupeds import QuadrupedBuild
from x2radar.sim.bodies.wander import Wander, smooth_step
from x2radar.sim.points import Array


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
        """Draw an animal that plays where a path begins.

        How fast it turns and hops is a guess; it shakes itself 4 to 5 times a second, small ones
        faster (Dickerson et al. 2012, recalled: the frequency goes with mass to the power -0.22).
        """
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
