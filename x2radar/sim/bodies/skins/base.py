"""What every skin is, and how strong the parts of a body echo against theory."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from x2radar.sim.points import Array, Points, Pose

SKIN_REFLECTION = 0.54  # of power, skin and muscle at 7 GHz (Gabriel's tissue data, recalled)
WAVELENGTH_M = 0.044  # at 6.8 GHz, the X2's carrier
DEEPEST = 0.7  # an antenna inside a part still has it in front, by this share of the distance
_FAR_M, _N_AZIMUTHS = 50.0, 24  # whence totals are taken: a body is a point from there
_MAX_SPREAD_DB = 4.0  # of parts' own draws of gain: recorded people differ by about as much


@dataclass(frozen=True, slots=True)
class EchoGain:
    """How strong the parts of a kind of body echo against theory; every body draws its own.

    Recorded people show stronger limbs than single bodies of theory have, a recorded dog weaker
    paws (docs/research/evaluation-tried.md); the numbers hold both.
    """

    max_power: float = 0.5  # large parts lose to small ones by up to so much of their ratio
    # Groups of parts, by number, and the most that each group loses, in dB.
    losses: tuple[tuple[tuple[int, ...], float], ...] = ()

    def draw_losses(self, rng: np.random.Generator, n_segments: int) -> Array:
        """Draw the factors of the groups' losses, shape (n_segments,)."""
        factor = np.ones(n_segments)
        for parts, most_db in self.losses:
            factor[list(parts)] *= 10 ** (-rng.uniform(0.0, most_db) / 10)
        return factor

    def draw(self, rng: np.random.Generator, size: Array) -> Array:
        """Draw what segments echo against theory, which gives `size`; weighted by it mean 1."""
        power, spread = rng.uniform(0.0, self.max_power), rng.uniform(0.0, _MAX_SPREAD_DB)
        noise = 10 ** (spread / 10 * rng.standard_normal(len(size)).clip(-2, 2))
        gain = (size / size.max()) ** -power * noise * self.draw_losses(rng, len(size))
        return np.asarray(gain * (size.sum() / (size * gain).sum()))


THEORY = EchoGain()  # of bodies of which nothing is known


class Skin(ABC):
    """How the segments of one body echo; everything random was drawn when it was made."""

    scale = 1.0  # factor on all cross sections

    def names(self, parts: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of its points, from those of the segments: one each."""
        return parts

    @abstractmethod
    def points(self, pose: Pose, antenna_m: Array) -> Points:
        """Return the echoes of a pose, as many as `names` has; `antenna_m` has shape (3,)."""

    def mean_total_m2(self, pose: Pose) -> float:
        """Return the sum of all cross sections, level from far away, over aspect and times."""
        middle = pose.centre_m.mean(axis=(0, 1))
        totals = []
        for turn in np.arange(_N_AZIMUTHS) * (2 * np.pi / _N_AZIMUTHS):
            antenna = middle + _FAR_M * np.array([np.cos(turn), np.sin(turn), 0.0])
            totals.append(self.points(pose, antenna).rcs_m2.sum(axis=1).mean())
        return float(np.mean(totals))
