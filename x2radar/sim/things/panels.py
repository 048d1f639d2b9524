"""Panels: a curtain in the draught, a door on its hinge."""

import numpy as np

from x2radar.sim.points import Label, Points
from x2radar.sim.things.draws import (
    RCS,
    TOWARDS,
    Array,
    Draw,
    Gust,
    ThingKind,
    Values,
    facing,
    grid,
    lit,
    shares,
)

_WAVES = 3
"""Along a curtain: fewer repeat themselves."""


class Curtain:
    """A panel of points; waves run along it, growing from the rod down to the hem.

    Displacement across the panel is ``A g (h) sum_k a_k sin(2 pi (f_k t - u / L_k) + p_k)``
    with ``sum a_k = 1``, so it never exceeds the amplitude A.
    """

    label: Label = "other"

    def __init__(self, rng: np.random.Generator, position_m: Array, values: Values) -> None:
        across, up = grid(values["width_m"], values["height_m"], 7, 4)
        n = across.size
        self.names = tuple(f"cloth {k + 1}" for k in range(n))
        right, self._ahead = facing(values["heading_deg"])
        folds_m = rng.uniform(-0.04, 0.04, n)
        self._rest_m = across[:, None] * right + folds_m[:, None] * self._ahead
        self._rest_m += [*position_m, values["floor_gap_m"]]
        self._rest_m[:, 2] += up
        self._swing_m = values["amplitude_m"] * (1 - up / values["height_m"])
        share, turns, length, sense = rng.random((4, _WAVES))
        self._share = (0.2 + share) / (0.2 + share).sum()
        self._hz = values["frequency_hz"] * np.array([1.0, 1.37, 0.61])
        wave_per_m = np.where(sense < 0.5, -1, 1) / (0.5 + 1.5 * length)
        self._turns = turns - across[:, None] * wave_per_m
        self._gust = Gust(rng, 0.05, 0.3)
        self._rcs_m2 = values["rcs_m2"] * shares(rng, n)

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points."""
        turns = t_s[:, None, None] * self._hz + self._turns
        wave = np.sin(2 * np.pi * turns) @ self._share
        away_m = wave * self._swing_m * (0.3 + 0.7 * self._gust.at(t_s))[:, None]
        position_m = self._rest_m + away_m[..., None] * self._ahead
        aspect = 0.3 + 0.7 * lit(self._ahead, position_m, antenna_m) ** 2
        return Points(position_m, self._rcs_m2 * aspect)


CURTAIN = ThingKind(
    "A curtain that sways in the draught, with waves along it.",
    {
        "heading_deg": TOWARDS,
        "width_m": Draw(0.2, 6, (0.8, 2.5), "width, m"),
        "height_m": Draw(0.2, 4, (1.2, 2.3), "height, m"),
        "floor_gap_m": Draw(0, 3, (0.02, 0.8), "from floor to hem, m"),
        "frequency_hz": Draw(0.05, 3, (0.2, 1.1), "main wave, Hz"),
        "amplitude_m": Draw(0, 0.3, (0.01, 0.06), "greatest swing of the hem, m"),
        "rcs_m2": RCS,
    },
    Curtain,
)


class Door:
    """A leaf on its hinge that opens, stands, shuts and rests, again and again."""

    label: Label = "other"

    def __init__(self, rng: np.random.Generator, position_m: Array, values: Values) -> None:
        across, up = grid(values["width_m"], values["height_m"], 6, 4)
        n = across.size
        self.names = tuple(f"leaf {k + 1}" for k in range(n))
        self._hinge_m = np.array([*position_m, 0.0])
        self._out_m = across + values["width_m"] / 2
        self._up_m = np.stack([0 * up, 0 * up, up], axis=1)
        self._heading_deg = values["heading_deg"]
        self._swing_deg = values["swing_deg"] * (1 if rng.random() < 0.5 else -1)
        move_s, rest_s = values["move_s"], values["rest_s"]
        self._ends_s = np.cumsum([move_s, rest_s, move_s * rng.uniform(0.5, 1.2), rest_s])
        self._begin_s = rng.uniform(0, self._ends_s[-1])
        self._sway = Gust(rng, 0.2, 0.8)
        self._sway_deg = values["sway_deg"]
        self._rcs_m2 = values["rcs_m2"] * shares(rng, n)

    def open_share(self, t_s: Array) -> Array:
        """Return how far it is open, 0 to 1, shape (n_slow,); it starts and stops gently."""
        opened, stood, shut, over = self._ends_s
        now_s = (t_s + self._begin_s) % over
        rise = np.clip(now_s / opened, 0, 1) - np.clip((now_s - stood) / (shut - stood), 0, 1)
        return np.asarray(0.5 - 0.5 * np.cos(np.pi * rise))

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points."""
        share = self.open_share(t_s)
        turn_deg = self._swing_deg * share + self._sway_deg * share * self._sway.at(t_s)
        along, across = facing(self._heading_deg + turn_deg)
        position_m = self._hinge_m + self._up_m + self._out_m[:, None] * along[:, None]
        # A plate is brightest where it faces the radar.
        aspect = 0.1 + 0.9 * lit(across[:, None], position_m, antenna_m) ** 4
        return Points(position_m, self._rcs_m2 * aspect)


DOOR = ThingKind(
    "A door that swings open and shut; nobody is there.",
    {
        "heading_deg": TOWARDS,
        "width_m": Draw(0.2, 2, (0.6, 0.9), "width of the leaf, m"),
        "height_m": Draw(0.2, 3, (1.9, 2.1), "height, m"),
        "swing_deg": Draw(0, 180, (15, 100), "from shut to open, degrees"),
        "move_s": Draw(0.3, 60, (1.0, 4.0), "time to open, s"),
        "rest_s": Draw(0, 3600, (0.5, 6.0), "time it stands open, and shut, s"),
        "sway_deg": Draw(0, 20, (0, 4), "to and fro while open, degrees"),
        "rcs_m2": RCS,
    },
    Door,
)
