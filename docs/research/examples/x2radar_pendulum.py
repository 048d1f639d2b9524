"""A metal ball on a string, two metres before the radar."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from x2radar.errors import SceneError
from x2radar.sim.points import Array, Label, Points
from x2radar.sim.scene.cast import BodyKind

KEYS = ("swing_m", "period_s", "range_m")


@dataclass(frozen=True, slots=True)
class Pendulum:
    """Swings towards the radar and back."""

    swing_m: float
    period_s: float
    range_m: float
    phase: float
    label: Label = "other"
    names: tuple[str, ...] = ("ball",)

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its one point; the cross section is that of a 25 cm sphere, pi r^2."""
        position_m = np.zeros((len(t_s), 1, 3))
        turns = np.asarray(t_s) / self.period_s + self.phase
        position_m[:, 0, 1] = self.range_m + self.swing_m * np.sin(2 * np.pi * turns)
        position_m[:, 0, 2] = 1.2
        return Points(position_m, np.full((len(t_s), 1), np.pi * 0.125**2))


def make(rng: np.random.Generator, options: Mapping[str, Any], where: str) -> Pendulum:
    """Return a pendulum with its own phase."""
    for key in options:
        if key not in KEYS:
            msg = f"{where}.{key}: unknown key; known are {', '.join(KEYS)}"
            raise SceneError(msg)
    values = {"swing_m": 0.3, "period_s": 2.0, "range_m": 2.0, **options}
    return Pendulum(**values, phase=float(rng.uniform()))


PENDULUM = BodyKind("A metal ball on a string.", make)
