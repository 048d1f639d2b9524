"""What all moving things share: numbers drawn or given, directions, gusts; and the mount.

The antenna's own mount vibrates: everything that stands still moves, and alike.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from x2radar.keys import Key, checked
from x2radar.sim.points import Array, Thing

Values = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Draw:
    """One number of a thing: its limits, and the usual ones from which it is drawn."""

    low: float  # least that a scene may ask for
    high: float
    usual: tuple[float, float]  # least and greatest that is drawn
    meaning: str  # a few words with the unit
    is_log: bool = False  # drawn evenly on a logarithmic scale

    def value(self, rng: np.random.Generator) -> float:
        """Return a usual value; one number is drawn."""
        low, high = self.usual
        share = rng.random()
        return float(low * (high / low) ** share if self.is_log else low + (high - low) * share)


@dataclass(frozen=True, slots=True)
class ThingKind:
    """One kind of moving thing."""

    draws: Mapping[str, Draw]  # its numbers, in the order in which they are drawn
    make: Callable[[np.random.Generator, Array, Values], Thing]


def numbered(name: str, n: int) -> tuple[str, ...]:
    """Return the names of n points that are alike."""
    return tuple(f"{name} {k + 1}" for k in range(n))


# Total cross section of a thing that is fully lit. Drawn over the same range for bodies and
# things: if it told them apart, a network would learn it instead of the movement.
RCS = Draw(1e-6, 1000, (0.03, 2.0), "total radar cross section, m2", is_log=True)
HEADING = Draw(-360, 360, (0, 360), "where it faces: 0 away from the radar, 90 right, degrees")
TOWARDS = Draw(-360, 360, (120, 240), "where it faces: 180 towards the radar, degrees")


def values_of(
    rng: np.random.Generator, draws: Mapping[str, Draw], raw: Any, where: str
) -> dict[str, float]:
    """Return a thing's numbers: what `raw` says, the rest drawn; or SceneError."""
    keys = {name: Key(d.low, d.high, d.meaning) for name, d in draws.items()}
    said = checked(raw, keys, where)
    drawn = {name: d.value(rng) for name, d in draws.items()}
    return {name: float(said.get(name, value)) for name, value in drawn.items()}


def facing(heading_deg: float | Array) -> tuple[Array, Array]:
    """Return unit vectors on the floor, shape (..., 3): to the thing's right, and ahead."""
    turn = np.deg2rad(heading_deg)
    sin, cos, zero = np.sin(turn), np.cos(turn), np.zeros_like(turn)
    return np.stack([cos, -sin, zero], axis=-1), np.stack([sin, cos, zero], axis=-1)


def lit(normal: Array, position_m: Array, antenna_m: Array) -> Array:
    """Return the cosine between normals and the ways to the antenna, shape (...), -1 to 1."""
    towards = antenna_m - position_m
    length = np.sqrt(np.einsum("...k,...k->...", towards, towards))
    return np.asarray(np.einsum("...k,...k->...", normal, towards) / np.maximum(length, 1e-9))


def grid(width_m: float, height_m: float, n_across: int, n_up: int) -> tuple[Array, Array]:
    """Return points of a panel, row by row: across from its middle, and above its lower edge."""
    across = width_m * ((np.arange(n_across) + 0.5) / n_across - 0.5)
    up = height_m * (np.arange(n_up) + 0.5) / n_up
    u, v = np.meshgrid(across, up)
    return u.ravel(), v.ravel()


def shares(rng: np.random.Generator, n: int) -> Array:
    """Return exponential strengths of n points with the sum 1."""
    strength = rng.exponential(size=n)
    return np.asarray(strength / strength.sum())


def draw_gust(
    rng: np.random.Generator, slow_hz: float, fast_hz: float
) -> Callable[[Array], Array]:
    """Return a slow random rise and fall, 0 to 1, by times (n_slow,): four sinusoids between."""
    share, turns = rng.random((2, 4))
    hz = slow_hz * (fast_hz / slow_hz) ** share
    return lambda t_s: 0.5 + 0.5 * np.sin(2 * np.pi * (t_s[:, None] * hz + turns)).mean(axis=1)


_DECAY_S = 0.2  # of a shock: a bracket rings for some swings
DRAWS = {
    "hum_hz": Draw(1, 200, (5, 30), "of the bracket, Hz"),
    "hum_m": Draw(0, 0.005, (1e-5, 3e-4), "greatest swing, m"),
    "shock_m": Draw(0, 0.01, (0, 1e-3), "swing at a shock, m"),
    "shock_s": Draw(0.1, 3600, (1, 20), "between shocks, s"),
    "sway_m": Draw(0, 0.01, (0, 5e-4), "slow sway, m"),
}


Mount = Callable[[Array], Array]
"""How far the antenna is off its place at times (n_slow,), shape (n_slow, 3), in metres."""


def draw_mount(rng: np.random.Generator, raw: Values | None = None, where: str = "mount") -> Mount:
    """Return hum, sway and shocks of a mount; what `raw` leaves out is drawn; or SceneError."""
    said = values_of(rng, DRAWS, raw, where)
    direction = rng.standard_normal((3, 3))
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    own_turn, own_moment = rng.random(2)
    swell, sway = draw_gust(rng, 0.02, 0.5), draw_gust(rng, 0.05, 0.3)

    def shocks(t_s: Array) -> Array:
        out, number = np.zeros(len(t_s)), np.floor(t_s / said["shock_s"])
        # A shock still rings in the intervals after its own, for ten times its decay.
        for back in range(math.ceil(10 * _DECAY_S / said["shock_s"]) + 1):
            n = number - back
            moment = (own_moment + 0.618_033_988_749_895 * n) % 1.0
            since_s = np.maximum(t_s - (n + moment) * said["shock_s"], 0.0)
            ring = np.sin(2 * np.pi * said["hum_hz"] * since_s) * np.exp(-since_s / _DECAY_S)
            out += said["shock_m"] * ring
        return out

    def offset_m(t_s: Array) -> Array:
        hum_m = said["hum_m"] * swell(t_s)
        hum_m *= np.sin(2 * np.pi * ((said["hum_hz"] * t_s + own_turn) % 1.0))
        sway_m = said["sway_m"] * (2 * sway(t_s) - 1)
        return np.asarray(np.stack([hum_m, sway_m, shocks(t_s)], axis=1) @ direction)

    return offset_m
