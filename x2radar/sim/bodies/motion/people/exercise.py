"""Somebody who exercises or dances in one place: the whole body to one beat.

Squats, jumping jacks, knees raised in turn, kicks, arms swung: all are a few sinusoids of one
beat and its double, with sizes and phases drawn for each person. Drawn, not captured: beats
of 0.4 to 1.6 Hz and the ranges of the joints are what everyday exercise takes (a guess).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from x2radar.sim.bodies.motion.people.doing import REST, Doing, within_reach
from x2radar.sim.bodies.wander import Wander, smooth_step
from x2radar.sim.points import Array

# Beats: see above; how uneven the beat is; middle and span of the hands, in lengths of the arm:
# by eye.
_BEAT_HZ = (0.4, 1.6)
_DRIFT_RAD = 0.8
_MIDDLE = np.array([0.50, 0.25, -0.20])
_SPAN = np.array([0.22, 0.40, 0.75])


@dataclass(frozen=True, slots=True, eq=False)
class Exercise:
    """Somebody's exercise; see `Doer`."""

    beat_hz: float  # beats a second
    drift: Wander  # of the beat, in radians
    effort: Wander  # one number in -1 to 1; it rests where that is low
    crouch: float  # how deep it squats, as a share of the leg
    hop_m: float  # how high both feet leave the floor
    step_m: Array  # (3,): how far a foot is put ahead and outward and is raised, once a beat
    is_in_turn: bool  # whether the feet go in turn, not together
    lean_rad: float  # amplitudes of trunk, chest and hips
    twist_rad: float
    sway_m: float
    hands: Array  # (2, 2, 3): at the beat and its double, by hand, in lengths of the arm
    phase_rad: Array  # (2, 3): of each hand's directions

    @classmethod
    def draw(cls, rng: np.random.Generator, leg_m: float) -> Self:
        """Draw the exercise of somebody whose legs are so long."""
        u = rng.random(11)
        low, high = np.log(_BEAT_HZ)
        size = rng.uniform(0.0, 1.0, (2, 1, 3)) * np.array([1.0, 0.4])[:, None, None] * _SPAN
        mirrored = np.repeat(size, 2, axis=1)
        phase = rng.uniform(0, 2 * np.pi, 3)
        return cls(
            beat_hz=float(np.exp(low + (high - low) * u[0])),
            drift=Wander.draw(rng, [_DRIFT_RAD], [0.4]),
            effort=Wander.draw(rng, [1.0], [0.3]),
            crouch=float(0.35 * u[1]) if u[2] < 0.5 else 0.0,
            hop_m=float(0.05 + 0.10 * u[3]) * leg_m if u[4] < 0.3 else 0.0,
            step_m=leg_m * np.array([0.5 * u[5] - 0.15, 0.25 * u[6], 0.04 + 0.36 * u[7] ** 2]),
            is_in_turn=bool(u[8] < 0.75),
            lean_rad=float(0.3 * u[9]),
            twist_rad=float(0.6 * u[10]),
            sway_m=0.04 * leg_m,
            hands=mirrored,
            # Arms go together or against each other.
            phase_rad=np.stack([phase, phase + np.pi * rng.integers(0, 2)]),
        )

    def at(self, t_s: Array, vigour: Array) -> Doing:
        """Return what is done; see `Doer`."""
        turn = 2 * np.pi * self.beat_hz * t_s + self.drift.at(t_s)[:, 0]
        share = (1 - vigour) * smooth_step(0.8 + 1.5 * self.effort.at(t_s)[:, 0])
        swing = np.sin(turn)
        raised = np.maximum(np.stack([swing, -swing if self.is_in_turn else swing], -1), 0) ** 2
        feet = raised[..., None] * self.step_m
        feet[:, 1, 1] *= -1
        hop = self.hop_m * np.maximum(np.sin(turn + 0.5 * np.pi), 0) ** 2
        feet[..., 2] += hop[:, None]
        angle = turn[:, None, None] + self.phase_rad
        hands = REST + share[:, None, None] * (
            _MIDDLE - REST + self.hands[0] * np.sin(angle) + self.hands[1] * np.sin(2 * angle)
        )
        # The weight goes to the foot that stands.
        sway = -self.sway_m * swing if self.is_in_turn else np.zeros(len(t_s))
        shift = np.stack([np.zeros(len(t_s)), sway, hop], axis=-1)
        return Doing(
            share,
            share[:, None] * shift,
            share * self.crouch * (0.5 - 0.5 * np.cos(turn)),
            share * self.lean_rad * np.sin(turn + 0.7),
            share * self.twist_rad * swing,
            within_reach(hands),
            np.stack([0.3 * share * self.twist_rad * swing, np.zeros(len(t_s))], axis=-1),
            share[:, None, None] * feet,
        )
