"""The trunk of somebody who goes: it pitches twice a stride, rolls once, and is never quite still.

Recorded people spread more power beside the trunk's velocity than stiff trunks do
(docs/research/evaluation-tried.md); amplitudes are chosen, wide.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.flyer.flight import Wander
from x2radar.sim.bodies.motion.limbs import direction

Array = NDArray[np.float64]

_SWING_RAD, _MOST_SIGMAS = 0.05, 2.0
"""Standard deviation of the amplitudes of pitch and roll, and where draws end."""
_WANDER_RAD, _WANDER_RAD_S = np.array([0.12, 0.10]), np.array([0.15, 0.12])
"""Limits and rates of what lean and roll do besides."""


@dataclass(frozen=True, slots=True, eq=False)
class Torso:
    """How a trunk swings over its hips.

    Attributes
    ----------
    pitch_rad, roll_rad : float
        Amplitudes at cruising speed, forward and to the left.
    pitch_lag, roll_lag : float
        In periods, against the left foot's landing.
    wander : Wander
        What is added to lean and roll, whether the body goes or stands.
    """

    pitch_rad: float
    roll_rad: float
    pitch_lag: float
    roll_lag: float
    wander: Wander

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """Draw a trunk's swing."""
        pitch_lag, roll_lag = rng.random(2)
        pitch, roll = _SWING_RAD * np.abs(rng.standard_normal(2)).clip(0, _MOST_SIGMAS)
        wander = Wander.draw(rng, _WANDER_RAD, _WANDER_RAD_S)
        return cls(float(pitch), float(roll), float(pitch_lag), float(roll_lag), wander)

    def up(
        self, t_s: Array, facing_rad: Array, lean_rad: Array, phase: Array, vigour: Array
    ) -> Array:
        """Return unit vectors from the hips to the neck, shape (n_slow, 3).

        `lean_rad` is the forward lean that the trunk swings about; `phase` is in strides, `vigour`
        0 standing to 1 at cruising speed; all of shape (n_slow,).
        """
        wander = self.wander.at(t_s)
        pitch = self.pitch_rad * vigour * np.sin(2 * np.pi * (2 * phase - self.pitch_lag))
        roll = self.roll_rad * vigour * np.sin(2 * np.pi * (phase - self.roll_lag)) + wander[:, 1]
        upright = direction(facing_rad, 0.5 * np.pi - (lean_rad + pitch + wander[:, 0]))
        left = direction(facing_rad + 0.5 * np.pi, np.zeros_like(facing_rad))
        return np.cos(roll)[:, None] * upright + np.sin(roll)[:, None] * left
