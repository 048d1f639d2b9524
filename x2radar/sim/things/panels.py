"""Panels: a curtain in the draught, a door on its hinge."""

import numpy as np

from x2radar.sim.points import Array, Points
from x2radar.sim.things.draws import (
    RCS,
    TOWARDS,
    Draw,
    Gust,
    Thing,
    ThingKind,
    Values,
    facing,
    grid,
    lit,
    numbered,
    shares,
)

_WAVES = 3
"""Along a curtain: fewer repeat themselves."""


def _curtain(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a panel of points; waves run along it, growing from the rod down to the hem.

    Displacement across the panel is ``A g (h) sum_k a_k sin(2 pi (f_k t - u / L_k) + p_k)``
    with ``sum a_k = 1``, so it never exceeds the amplitude A.
    """
    across, up = grid(values["width_m"], values["height_m"], 7, 4)
    n = across.size
    right, ahead = facing(values["heading_deg"])
    folds_m = rng.uniform(-0.04, 0.04, n)
    rest_m = across[:, None] * right + folds_m[:, None] * ahead
    rest_m += [*position_m, values["floor_gap_m"]]
    rest_m[:, 2] += up
    swing_m = values["amplitude_m"] * (1 - up / values["height_m"])
    share, start, length, sense = rng.random((4, _WAVES))
    share = (0.2 + share) / (0.2 + share).sum()
    hz = values["frequency_hz"] * np.array([1.0, 1.37, 0.61])
    wave_per_m = np.where(sense < 0.5, -1, 1) / (0.5 + 1.5 * length)
    start = start - across[:, None] * wave_per_m
    gust = Gust(rng, 0.05, 0.3)
    rcs_m2 = values["rcs_m2"] * shares(rng, n)

    def points(t_s: Array, antenna_m: Array) -> Points:
        wave = np.sin(2 * np.pi * (t_s[:, None, None] * hz + start)) @ share
        away_m = wave * swing_m * (0.3 + 0.7 * gust.at(t_s))[:, None]
        position_m = rest_m + away_m[..., None] * ahead
        return Points(position_m, rcs_m2 * (0.3 + 0.7 * lit(ahead, position_m, antenna_m) ** 2))

    return Thing(numbered("cloth", n), points)


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
    _curtain,
)


def _door(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a leaf on its hinge that opens, stands, shuts and rests, again and again."""
    across, up = grid(values["width_m"], values["height_m"], 6, 4)
    hinge_m, out_m = np.array([*position_m, 0.0]), across + values["width_m"] / 2
    up_m = np.stack([0 * up, 0 * up, up], axis=1)
    swing_deg = values["swing_deg"] * (1 if rng.random() < 0.5 else -1)
    move_s, rest_s = values["move_s"], values["rest_s"]
    ends_s = np.cumsum([move_s, rest_s, move_s * rng.uniform(0.5, 1.2), rest_s])
    opened, stood, shut, over = ends_s
    begin_s = rng.uniform(0, over)
    sway = Gust(rng, 0.2, 0.8)
    rcs_m2 = values["rcs_m2"] * shares(rng, across.size)

    def points(t_s: Array, antenna_m: Array) -> Points:
        now_s = (t_s + begin_s) % over
        rise = np.clip(now_s / opened, 0, 1) - np.clip((now_s - stood) / (shut - stood), 0, 1)
        # How far it is open, 0 to 1; it starts and stops gently.
        share = 0.5 - 0.5 * np.cos(np.pi * rise)
        turn_deg = swing_deg * share + values["sway_deg"] * share * sway.at(t_s)
        along, ahead = facing(values["heading_deg"] + turn_deg)
        position_m = hinge_m + up_m + out_m[:, None] * along[:, None]
        # A plate is brightest where it faces the radar.
        aspect = 0.1 + 0.9 * lit(ahead[:, None], position_m, antenna_m) ** 4
        return Points(position_m, rcs_m2 * aspect)

    return Thing(numbered("leaf", across.size), points)


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
    _door,
)
