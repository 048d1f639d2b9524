"""A hanging plant: a pendulum with leaves."""

import numpy as np

from x2radar.sim.points import Label, Points
from x2radar.sim.things.draws import RCS, Array, Draw, Gust, ThingKind, Values, shares

_GRAVITY = 9.81
_N_LEAVES = 12
"""So many that none stands out."""


class Plant:
    """A pot on a string: two swings of its own period, a twist, fluttering leaves."""

    label: Label = "other"

    def __init__(self, rng: np.random.Generator, position_m: Array, values: Values) -> None:
        self.names = ("pot", *(f"leaf {k + 1}" for k in range(_N_LEAVES)))
        self._string_m = values["string_m"]
        self._hook_m = np.array([*position_m, values["height_m"] + self._string_m])
        own_hz = np.sqrt(_GRAVITY / self._string_m) / (2 * np.pi)
        # Leaves and string make the two directions swing at slightly different rates.
        self._swing_hz = own_hz * (1 + 0.02 * rng.standard_normal(2))
        self._swing_turns = rng.random(2)
        axis = rng.uniform(0, 2 * np.pi)
        strength = np.array([1.0, rng.uniform(0.1, 0.7)])
        strength /= np.linalg.norm(strength)
        turned = np.array([[np.cos(axis), np.sin(axis)], [-np.sin(axis), np.cos(axis)]])
        self._swing_m = values["amplitude_m"] * strength[:, None] * turned
        self._gusts = (Gust(rng, 0.01, 0.1), Gust(rng, 0.01, 0.1))
        away = rng.standard_normal((_N_LEAVES, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        out_m = values["radius_m"] * rng.uniform(0.4, 1.0, (_N_LEAVES, 1))
        self._leaf_m = np.vstack([np.zeros(3), out_m * away])
        self._twist_rad, self._twist_hz = rng.uniform(0.05, 0.4), rng.uniform(0.1, 0.4)
        self._flutter_hz = rng.uniform(1.0, 4.0, _N_LEAVES + 1)
        self._flutter_turns = rng.random(_N_LEAVES + 1)
        self._flutter_m = values["flutter_m"] * rng.random((_N_LEAVES + 1, 3))
        self._flutter_m[0] = 0.0
        self._rcs_m2 = values["rcs_m2"] * shares(rng, _N_LEAVES + 1)

    def at(self, t_s: Array, antenna_m: Array) -> Points:  # noqa: ARG002 - of the protocol
        """Return its points. Leaves have no aspect."""
        turns = t_s[:, None] * self._swing_hz + self._swing_turns
        gusts = np.stack([g.at(t_s) for g in self._gusts], axis=1)
        across_m = (np.sin(2 * np.pi * turns) * gusts) @ self._swing_m
        # The string stays as long as it is.
        down_m = np.sqrt(self._string_m**2 - (across_m**2).sum(axis=1))
        pot_m = self._hook_m + np.column_stack([across_m, -down_m])
        twist = self._twist_rad * np.sin(2 * np.pi * self._twist_hz * t_s)[:, None]
        x, y, z = self._leaf_m.T
        cos, sin = np.cos(twist), np.sin(twist)
        leaf_m = np.stack([x * cos - y * sin, x * sin + y * cos, z + 0 * twist], axis=-1)
        flutter = np.sin(2 * np.pi * (t_s[:, None] * self._flutter_hz + self._flutter_turns))
        moved_m = flutter[..., None] * self._flutter_m * gusts[:, :1, None]
        position_m = pot_m[:, None] + leaf_m + moved_m
        return Points(position_m, np.tile(self._rcs_m2, (len(t_s), 1)))


PLANT = ThingKind(
    "A hanging plant that swings like a pendulum, its leaves trembling.",
    {
        "height_m": Draw(0, 5, (1.2, 2.0), "of the pot above the floor, m"),
        "string_m": Draw(0.2, 5, (0.3, 1.0), "from hook to pot, m"),
        "radius_m": Draw(0.01, 1, (0.1, 0.25), "of the leaves, m"),
        "amplitude_m": Draw(0, 0.15, (0.01, 0.08), "greatest swing, m"),
        "flutter_m": Draw(0, 0.05, (0, 0.006), "greatest tremble of a leaf, m"),
        "rcs_m2": RCS,
    },
    Plant,
)
