"""How scatterers move: the thesis' bodies, sums of sinusoids on a straight line.

Equations and parameters are those of the thesis' appendices A and B (tables 4.1, B.4):
``y(t) = y0 + vy t + Ay1 sin(w t + phi) + Ay3 sin(3 w t + phi)``, the radar at the origin,
y away from it. Every body draws one random variation, shared by all its scatterers.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from x2radar.sim.points import Array, Label, Points, Thing

SEED_GAIN = 1e4  # 40 dB of the module's integration are in the thesis' (table 4.1)
_HALF_TURN = np.pi / 2


class Scatterer(NamedTuple):
    """A point of a body, with its sinusoid about the trunk."""

    x_m: float  # at the start
    y_m: float
    z_m: float
    vy_mps: float  # along y; negative approaches
    gait_hz: float  # frequency of the swing along y
    phase_rad: float
    swing_m: float
    swing3_m: float  # amplitude of its third harmonic
    rcs_m2: float  # integration gain included: 10,000 m2 stand for about 1 m2 and 40 dB


# Columns of a scatterer that vary, and their standard deviations (table B.4).
_VARIED, _SPREAD = [0, 1, 3, 4, 5, 6], np.array([0.75, 1.0, 0.5, 0.25, np.pi / 4, 0.05])
_RCS_SPREAD, _MIN_RCS = 0.3, 0.05  # standard deviation (table B.4), and least share left


THESIS_BODIES: Mapping[str, tuple[Scatterer, ...]] = {
    "thesis_human": (
        Scatterer(0, 2.5, 0, -1, 2, _HALF_TURN, 0.1, 0, 10_000),
        Scatterer(0.25, 2.5, 0, -1, 1, _HALF_TURN, 0.3, 0.02, 500),
        Scatterer(-0.25, 2.5, 0, -1, 1, -_HALF_TURN, 0.3, 0.02, 500),
        Scatterer(0.12, 2.5, -0.6, -1, 1, -_HALF_TURN, 0.2, 0.01, 1_000),
        Scatterer(-0.12, 2.5, -0.6, -1, 1, _HALF_TURN, 0.2, 0.01, 1_000),
    ),
    "thesis_dog": (
        Scatterer(0, 2.5, 0, -1, 2, _HALF_TURN, 0.1, 0, 5_000),
        Scatterer(0.1, 2.5, 0, -1, 1, _HALF_TURN, 0.1, 0.01, 500),
        Scatterer(-0.1, 2.5, 0, -1, 1, -_HALF_TURN, 0.1, 0.01, 500),
        Scatterer(0.1, 3, 0, -1, 1, -_HALF_TURN, 0.1, 0.01, 500),
        Scatterer(-0.1, 3, 0, -1, 1, _HALF_TURN, 0.1, 0.01, 500),
    ),
    "thesis_cat": (
        Scatterer(0, 2.5, 0, -1, 2.6, _HALF_TURN, 0.04, 0, 2_000),
        Scatterer(0.075, 2.5, 0, -1, 1.3, _HALF_TURN, 0.05, 0.01, 200),
        Scatterer(-0.075, 2.5, 0, -1, 1.3, -_HALF_TURN, 0.05, 0.01, 200),
        Scatterer(0.075, 2.8, 0, -1, 1.3, -_HALF_TURN, 0.05, 0.01, 200),
        Scatterer(-0.075, 2.8, 0, -1, 1.3, _HALF_TURN, 0.05, 0.01, 200),
    ),
}
"""Bodies by name; torso first."""


def draw(body: tuple[Scatterer, ...], rng: np.random.Generator) -> tuple[Scatterer, ...]:
    """Return a body with one random variation, of seven normal numbers, of all its scatterers."""
    *z, z_rcs = rng.standard_normal(7)
    rows = np.array(body)
    rows[:, _VARIED] += _SPREAD * z
    rows[:, -1] *= max(1 + _RCS_SPREAD * z_rcs, _MIN_RCS)
    return tuple(Scatterer(*row) for row in rows.tolist())


def ranges(body: tuple[Scatterer, ...], t_s: Array) -> tuple[Array, Array]:
    """Return distances in metres, (n_slow, n_scatterers), and cross sections in m2."""
    position_m, rcs_m2 = ranges_xyz(body, t_s)
    x, y, z = np.moveaxis(position_m, -1, 0)
    return np.sqrt(x**2 + y**2 + z**2), rcs_m2


def ranges_xyz(body: tuple[Scatterer, ...], t_s: Array) -> tuple[Array, Array]:
    """Return the scatterers' places, (n_slow, n_scatterers, 3), and their RCS; see `ranges`."""
    x, y0, z, vy, hz, phase, a1, a3, rcs = np.array(body).reshape(-1, 9).T
    t = t_s[:, None]
    turn = 2 * np.pi * hz * t
    y = y0 + vy * t + a1 * np.sin(turn + phase) + a3 * np.sin(3 * turn + phase)
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1), rcs


def draw_thesis_body(rng: np.random.Generator, *, name: str) -> Thing:
    """Draw a body of `THESIS_BODIES` on its way; the thesis' origin is the antenna."""
    scatterers = draw(THESIS_BODIES[name], rng)
    label: Label = "human" if name == "thesis_human" else "pet"

    def points(t_s: Array, antenna_m: Array) -> Points:
        position_m, rcs_m2 = ranges_xyz(scatterers, t_s)
        level = np.broadcast_to(rcs_m2 / SEED_GAIN, position_m.shape[:2])
        return Points(position_m + antenna_m, level)

    return Thing(tuple(f"scatterer {k + 1}" for k in range(len(scatterers))), points, label)
