"""What hangs or stands: a curtain, a door on its hinge, a plant; and rain on a window."""

import numpy as np

from x2radar.sim.points import Array, Points, Thing
from x2radar.sim.things import draws
from x2radar.sim.things.draws import Draw, ThingKind, Values

_WAVES = 3  # along a curtain: fewer repeat themselves


def _curtain(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a panel of points; waves run along it, growing from the rod down to the hem.

    Displacement across the panel is ``A g (h) sum_k a_k sin(2 pi (f_k t - u / L_k) + p_k)``
    with ``sum a_k = 1``, so it never exceeds the amplitude A.
    """
    across, up = draws.grid(values["width_m"], values["height_m"], 7, 4)
    n = across.size
    right, ahead = draws.facing(values["heading_deg"])
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
    gust = draws.draw_gust(rng, 0.05, 0.3)
    rcs_m2 = values["rcs_m2"] * draws.shares(rng, n)

    def points(t_s: Array, antenna_m: Array) -> Points:
        wave = np.sin(2 * np.pi * (t_s[:, None, None] * hz + start)) @ share
        away_m = wave * swing_m * (0.3 + 0.7 * gust(t_s))[:, None]
        position_m = rest_m + away_m[..., None] * ahead
        return Points(
            position_m, rcs_m2 * (0.3 + 0.7 * draws.lit(ahead, position_m, antenna_m) ** 2)
        )

    return Thing(draws.numbered("cloth", n), points)


CURTAIN = ThingKind(
    "A curtain that sways in the draught, with waves along it.",
    {
        "heading_deg": draws.TOWARDS,
        "width_m": Draw(0.2, 6, (0.8, 2.5), "width, m"),
        "height_m": Draw(0.2, 4, (1.2, 2.3), "height, m"),
        "floor_gap_m": Draw(0, 3, (0.02, 0.8), "from floor to hem, m"),
        "frequency_hz": Draw(0.05, 3, (0.2, 1.1), "main wave, Hz"),
        "amplitude_m": Draw(0, 0.3, (0.01, 0.06), "greatest swing of the hem, m"),
        "rcs_m2": draws.RCS,
    },
    _curtain,
)


def _door(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a leaf on its hinge that opens, stands, shuts and rests, again and again."""
    across, up = draws.grid(values["width_m"], values["height_m"], 6, 4)
    hinge_m, out_m = np.array([*position_m, 0.0]), across + values["width_m"] / 2
    up_m = np.stack([0 * up, 0 * up, up], axis=1)
    swing_deg = values["swing_deg"] * (1 if rng.random() < 0.5 else -1)
    move_s, rest_s = values["move_s"], values["rest_s"]
    ends_s = np.cumsum([move_s, rest_s, move_s * rng.uniform(0.5, 1.2), rest_s])
    opened, stood, shut, over = ends_s
    begin_s = rng.uniform(0, over)
    sway = draws.draw_gust(rng, 0.2, 0.8)
    rcs_m2 = values["rcs_m2"] * draws.shares(rng, across.size)

    def points(t_s: Array, antenna_m: Array) -> Points:
        now_s = (t_s + begin_s) % over
        rise = np.clip(now_s / opened, 0, 1) - np.clip((now_s - stood) / (shut - stood), 0, 1)
        # How far it is open, 0 to 1; it starts and stops gently.
        share = 0.5 - 0.5 * np.cos(np.pi * rise)
        turn_deg = swing_deg * share + values["sway_deg"] * share * sway(t_s)
        along, ahead = draws.facing(values["heading_deg"] + turn_deg)
        position_m = hinge_m + up_m + out_m[:, None] * along[:, None]
        # A plate is brightest where it faces the radar.
        aspect = 0.1 + 0.9 * draws.lit(ahead[:, None], position_m, antenna_m) ** 4
        return Points(position_m, rcs_m2 * aspect)

    return Thing(draws.numbered("leaf", across.size), points)


DOOR = ThingKind(
    "A door that swings open and shut; nobody is there.",
    {
        "heading_deg": draws.TOWARDS,
        "width_m": Draw(0.2, 2, (0.6, 0.9), "width of the leaf, m"),
        "height_m": Draw(0.2, 3, (1.9, 2.1), "height, m"),
        "swing_deg": Draw(0, 180, (15, 100), "from shut to open, degrees"),
        "move_s": Draw(0.3, 60, (1.0, 4.0), "time to open, s"),
        "rest_s": Draw(0, 3600, (0.5, 6.0), "time it stands open, and shut, s"),
        "sway_deg": Draw(0, 20, (0, 4), "to and fro while open, degrees"),
        "rcs_m2": draws.RCS,
    },
    _door,
)

_GRAVITY = 9.81
_N_LEAVES = 12  # so many that none stands out
# Successive drops of one track start where a golden section takes them: never twice alike.
_GOLDEN = 0.618_033_988_749_895


def _plant(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a pot on a string: two swings of its own period, a twist, leaves without aspect."""
    string_m = values["string_m"]
    hook_m = np.array([*position_m, values["height_m"] + string_m])
    own_hz = np.sqrt(_GRAVITY / string_m) / (2 * np.pi)
    # Leaves and string make the two directions swing at slightly different rates.
    swing_hz, swing_turns = own_hz * (1 + 0.02 * rng.standard_normal(2)), rng.random(2)
    axis = rng.uniform(0, 2 * np.pi)
    strength = np.array([1.0, rng.uniform(0.1, 0.7)])
    strength /= np.linalg.norm(strength)
    turned = np.array([[np.cos(axis), np.sin(axis)], [-np.sin(axis), np.cos(axis)]])
    swing_m = values["amplitude_m"] * strength[:, None] * turned
    both = (draws.draw_gust(rng, 0.01, 0.1), draws.draw_gust(rng, 0.01, 0.1))
    away = rng.standard_normal((_N_LEAVES, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    out_m = values["radius_m"] * rng.uniform(0.4, 1.0, (_N_LEAVES, 1))
    x, y, z = np.vstack([np.zeros(3), out_m * away]).T
    twist_rad, twist_hz = rng.uniform(0.05, 0.4), rng.uniform(0.1, 0.4)
    flutter_hz, flutter_turns = rng.uniform(1.0, 4.0, _N_LEAVES + 1), rng.random(_N_LEAVES + 1)
    flutter_m = values["flutter_m"] * rng.random((_N_LEAVES + 1, 3))
    flutter_m[0] = 0.0
    rcs_m2 = values["rcs_m2"] * draws.shares(rng, _N_LEAVES + 1)

    def points(t_s: Array, _antenna_m: Array) -> Points:
        gusts = np.stack([g(t_s) for g in both], axis=1)
        turns = t_s[:, None] * swing_hz + swing_turns
        across_m = (np.sin(2 * np.pi * turns) * gusts) @ swing_m
        # The string stays as long as it is.
        down_m = np.sqrt(string_m**2 - (across_m**2).sum(axis=1))
        pot_m = hook_m + np.column_stack([across_m, -down_m])
        twist = twist_rad * np.sin(2 * np.pi * twist_hz * t_s)[:, None]
        cos, sin = np.cos(twist), np.sin(twist)
        leaf_m = np.stack([x * cos - y * sin, x * sin + y * cos, z + 0 * twist], axis=-1)
        flutter = np.sin(2 * np.pi * (t_s[:, None] * flutter_hz + flutter_turns))
        moved_m = flutter[..., None] * flutter_m * gusts[:, :1, None]
        return Points(pot_m[:, None] + leaf_m + moved_m, np.tile(rcs_m2, (len(t_s), 1)))

    return Thing(("pot", *draws.numbered("leaf", _N_LEAVES)), points)


PLANT = ThingKind(
    "A hanging plant that swings like a pendulum, its leaves trembling.",
    {
        "height_m": Draw(0, 5, (1.2, 2.0), "of the pot above the floor, m"),
        "string_m": Draw(0.2, 5, (0.3, 1.0), "from hook to pot, m"),
        "radius_m": Draw(0.01, 1, (0.1, 0.25), "of the leaves, m"),
        "amplitude_m": Draw(0, 0.15, (0.01, 0.08), "greatest swing, m"),
        "flutter_m": Draw(0, 0.05, (0, 0.006), "greatest tremble of a leaf, m"),
        "rcs_m2": draws.RCS,
    },
    _plant,
)


def _rain(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw tracks on a pane; on each, one drop after another runs down and then rests.

    A drop moves by ``s - b sin(2 pi m s) / (2 pi m)`` of its way with s even in time: it never
    runs up, and for b near 1 almost stops m times. A resting track has no cross section.
    """
    n = round(values["n_drops"])
    sill_m, height_m = np.array([*position_m, values["sill_m"]]), values["height_m"]
    right, _ = draws.facing(values["heading_deg"])
    run_s = height_m / (values["speed_mps"] * np.exp(0.5 * rng.standard_normal(n)))
    cycle_s = run_s * rng.uniform(1.1, 3.0, n)
    begin, track = rng.random((2, n))
    turn = 2 * np.pi * rng.integers(1, 6, n)
    sticky = rng.uniform(0.3, 0.98, n)
    rcs_m2 = values["rcs_m2"] * draws.shares(rng, n)

    def points(t_s: Array, _antenna_m: Array) -> Points:
        number, now = np.divmod(t_s[:, None] / cycle_s + begin, 1.0)
        share = np.minimum(now * cycle_s / run_s, 1.0)
        fallen = share - sticky * np.sin(turn * share) / turn
        across = (track + _GOLDEN * number) % 1.0 - 0.5
        position_m = sill_m + (across * values["width_m"])[..., None] * right
        position_m[..., 2] += height_m * (1 - fallen)
        return Points(position_m, np.where(share < 1, rcs_m2, 0.0))

    return Thing(draws.numbered("drop", n), points)


RAIN = ThingKind(
    "Rain on a window: many weak drops that run down in fits and starts.",
    {
        "heading_deg": draws.TOWARDS,
        "width_m": Draw(0.1, 6, (0.6, 1.5), "of the pane, m"),
        "height_m": Draw(0.1, 4, (0.6, 1.4), "of the pane, m"),
        "sill_m": Draw(0, 5, (0.7, 1.1), "of its lower edge above the floor, m"),
        "n_drops": Draw(1, 200, (12, 40), "tracks, rounded"),
        "speed_mps": Draw(0.001, 2, (0.02, 0.3), "mean of a drop, m/s", is_log=True),
        "rcs_m2": Draw(1e-9, 1, (1e-4, 1e-2), "of all drops together, m2", is_log=True),
    },
    _rain,
)
