"""How scatterers move: the thesis' bodies, sums of sinusoids on a straight line.

Equations and parameters are those of the thesis' appendices A and B (tables 4.1, B.4):
``y(t) = y0 + vy t + Ay1 sin(w t + phi) + Ay3 sin(3 w t + phi)``, the radar at the origin,
y away from it. Every body draws one random variation, shared by all its scatterers.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from x2radar.sim.points import Array

_HALF_TURN = np.pi / 2


@dataclass(frozen=True, slots=True)
class Scatterer:
    """One point of a body."""

    x_m: float  # at the start
    y_m: float
    z_m: float
    vy_mps: float  # along y; negative approaches
    gait_hz: float  # frequency of the swing along y
    phase_rad: float
    swing_m: float
    swing3_m: float  # amplitude of its third harmonic
    rcs_m2: float  # integration gain included: 10,000 m2 stand for about 1 m2 and 40 dB


@dataclass(frozen=True, slots=True)
class Variation:
    """Standard deviations of a body's random variation (the thesis' table B.4)."""

    x_m: float = 0.75
    y_m: float = 1.0
    vy_mps: float = 0.5
    gait_hz: float = 0.25
    phase_rad: float = np.pi / 4
    swing_m: float = 0.05
    rcs_fraction: float = 0.3


def _dog_like(
    *,
    torso: tuple[float, float, float],
    limb: tuple[float, float, float],
    x_m: float,
    hind_m: float,
) -> tuple[Scatterer, ...]:
    (torso_hz, torso_m, torso_rcs), (limb_hz, limb_m, limb_rcs) = torso, limb
    legs = [
        Scatterer(side * x_m, y, 0, -1, limb_hz, side * sign * _HALF_TURN, limb_m, 0.01, limb_rcs)
        for y, sign in ((2.5, 1), (hind_m, -1))
        for side in (1, -1)
    ]
    return (Scatterer(0, 2.5, 0, -1, torso_hz, _HALF_TURN, torso_m, 0, torso_rcs), *legs)


THESIS_BODIES: Mapping[str, tuple[Scatterer, ...]] = {
    "thesis_human": (
        Scatterer(0, 2.5, 0, -1, 2, _HALF_TURN, 0.1, 0, 10_000),
        Scatterer(0.25, 2.5, 0, -1, 1, _HALF_TURN, 0.3, 0.02, 500),
        Scatterer(-0.25, 2.5, 0, -1, 1, -_HALF_TURN, 0.3, 0.02, 500),
        Scatterer(0.12, 2.5, -0.6, -1, 1, -_HALF_TURN, 0.2, 0.01, 1_000),
        Scatterer(-0.12, 2.5, -0.6, -1, 1, _HALF_TURN, 0.2, 0.01, 1_000),
    ),
    "thesis_dog": _dog_like(torso=(2, 0.1, 5_000), limb=(1, 0.1, 500), x_m=0.10, hind_m=3.0),
    "thesis_cat": _dog_like(
        torso=(2.6, 0.04, 2_000), limb=(1.3, 0.05, 200), x_m=0.075, hind_m=2.8
    ),
}
"""Bodies by name; torso first."""


def draw(
    body: tuple[Scatterer, ...], rng: np.random.Generator, spread: Variation | None = None
) -> tuple[Scatterer, ...]:
    """Return a body with one random variation, of seven normal numbers, of all its scatterers.

    Radar cross sections stay above 5 % of their mean.
    """
    s = spread or Variation()
    dx, dy, dv, dw, dp, da, dr = rng.standard_normal(7)
    return tuple(
        replace(
            p,
            x_m=p.x_m + s.x_m * dx,
            y_m=p.y_m + s.y_m * dy,
            vy_mps=p.vy_mps + s.vy_mps * dv,
            gait_hz=p.gait_hz + s.gait_hz * dw,
            phase_rad=p.phase_rad + s.phase_rad * dp,
            swing_m=p.swing_m + s.swing_m * da,
            rcs_m2=p.rcs_m2 * max(1 + s.rcs_fraction * dr, 0.05),
        )
        for p in body
    )


def ranges(body: tuple[Scatterer, ...], t_s: Array) -> tuple[Array, Array]:
    """Return distances in metres, shape (n_slow, n_scatterers), and cross sections in m2.

    Times are since the body's start; cross sections are of shape (n_scatterers,).
    """
    position_m, rcs_m2 = ranges_xyz(body, t_s)
    x, y, z = np.moveaxis(position_m, -1, 0)
    return np.sqrt(x**2 + y**2 + z**2), rcs_m2


def ranges_xyz(body: tuple[Scatterer, ...], t_s: Array) -> tuple[Array, Array]:
    """Return where the scatterers are, shape (n_slow, n_scatterers, 3), and their RCS.

    The radar is the origin; otherwise as `ranges`.
    """
    columns = [
        (p.x_m, p.y_m, p.z_m, p.vy_mps, p.gait_hz, p.phase_rad, p.swing_m, p.swing3_m, p.rcs_m2)
        for p in body
    ]
    x, y0, z, vy, hz, phase, a1, a3, rcs = np.array(columns).reshape(-1, 9).T
    t = t_s[:, None]
    turn = 2 * np.pi * hz * t
    y = y0 + vy * t + a1 * np.sin(turn + phase) + a3 * np.sin(3 * turn + phase)
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1), rcs
