"""Joint angles over a stride as short Fourier series, drawn about published means.

Means for people are the usual sagittal curves of level walking and running (Winter,
Biomechanics and Motor Control of Human Movement; Novacheck, The biomechanics of running, 1998;
read off at tenths of a stride, recalled). Those for dogs follow treadmill kinematics of trotting
dogs (Hottinger et al., Noninvasive computer-assisted gait analysis of dogs, 1996; recalled).
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from x2radar.sim.points import Array

N_HARMONICS = 4
"""Enough to hold a knee to two degrees (tests)."""

# Degrees at 0, 10, ..., 90 % of a stride that begins with the foot's landing.
WALK = (
    (30, 26, 18, 8, -2, -9, -7, 10, 26, 32),  # hip
    (5, 16, 16, 9, 5, 11, 34, 58, 45, 12),  # knee
    (0, -3, 4, 8, 9, 5, -15, -8, 0, 2),  # ankle
)
RUN = (
    (32, 24, 10, -4, -8, 2, 22, 40, 44, 38),
    (14, 38, 38, 22, 26, 58, 88, 92, 62, 22),
    (4, 16, 20, 2, -22, -16, -4, 2, 4, 4),
)
DOG = (
    (14, 8, 0, -8, -14, -17, -10, 4, 14, 17),  # shoulder
    (22, 30, 30, 26, 20, 22, 48, 72, 60, 32),  # elbow
    (18, 12, 4, -6, -14, -18, -12, 4, 16, 20),  # hip
    (24, 32, 32, 28, 24, 26, 48, 66, 52, 30),  # stifle
)


def harmonics(degrees: ArrayLike) -> NDArray[np.complex128]:
    """Return the first Fourier coefficients, in radians, of a curve at even steps of a stride."""
    curve = np.deg2rad(np.asarray(degrees, np.float64))
    return np.asarray(np.fft.rfft(curve)[: N_HARMONICS + 1] / len(curve))


@dataclass(frozen=True, slots=True, eq=False)
class JointCurve:
    """An angle over the phase of a stride."""

    mean_rad: float  # over the stride
    amplitude_rad: Array  # (N_HARMONICS,): of the harmonics
    phase_rad: Array  # (N_HARMONICS,)

    @classmethod
    def draw(
        cls, rng: np.random.Generator, coefficients: NDArray[np.complex128], scale: float = 1.0
    ) -> Self:
        """Draw a curve about a mean one.

        Each harmonic's size is spread by a fifth, its phase by 0.15 rad a harmonic, and a tenth
        of the first goes to every other one at random; the mean by 5 degrees. The spreads are
        about twice those between people (Winter).
        """
        n = N_HARMONICS
        c = coefficients[1:]
        size = 2 * scale * np.abs(c) * np.exp(0.2 * rng.standard_normal(n))
        size += 0.1 * size[0] * rng.random(n) * (np.arange(n) > 0)
        phase = np.angle(c) + 0.15 * rng.standard_normal(n)
        mean = scale * float(coefficients[0].real) + np.deg2rad(5.0) * rng.standard_normal()
        return cls(float(mean), size, phase)

    def at(self, phase: Array, vigour: Array) -> Array:
        """Return the angle, in radians, at phases in strides; `vigour` 0 leaves the mean alone."""
        turn = 2 * np.pi * phase[:, None] * np.arange(1, N_HARMONICS + 1) + self.phase_rad
        swing = (self.amplitude_rad * np.cos(turn)).sum(axis=1)
        return np.asarray(self.mean_rad * (0.3 + 0.7 * vigour) + vigour * swing)
