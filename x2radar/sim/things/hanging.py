"""What hangs: a plant, a pendulum with leaves; and rain on a window, drops that stop and go."""

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
    numbered,
    shares,
)

_GRAVITY = 9.81
_N_LEAVES = 12
"""So many that none stands out."""
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
    both = (Gust(rng, 0.01, 0.1), Gust(rng, 0.01, 0.1))
    away = rng.standard_normal((_N_LEAVES, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    out_m = values["radius_m"] * rng.uniform(0.4, 1.0, (_N_LEAVES, 1))
    x, y, z = np.vstack([np.zeros(3), out_m * away]).T
    twist_rad, twist_hz = rng.uniform(0.05, 0.4), rng.uniform(0.1, 0.4)
    flutter_hz, flutter_turns = rng.uniform(1.0, 4.0, _N_LEAVES + 1), rng.random(_N_LEAVES + 1)
    flutter_m = values["flutter_m"] * rng.random((_N_LEAVES + 1, 3))
    flutter_m[0] = 0.0
    rcs_m2 = values["rcs_m2"] * shares(rng, _N_LEAVES + 1)

    def points(t_s: Array, _antenna_m: Array) -> Points:
        gusts = np.stack([g.at(t_s) for g in both], axis=1)
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

    return Thing(("pot", *numbered("leaf", _N_LEAVES)), points)


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
    _plant,
)


def _rain(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw tracks on a pane; on each, one drop after another runs down and then rests.

    A drop moves by ``s - b sin(2 pi m s) / (2 pi m)`` of its way with s even in time: it never
    runs up, and for b near 1 almost stops m times. A resting track has no cross section.
    """
    n = round(values["n_drops"])
    sill_m, height_m = np.array([*position_m, values["sill_m"]]), values["height_m"]
    right, _ = facing(values["heading_deg"])
    run_s = height_m / (values["speed_mps"] * np.exp(0.5 * rng.standard_normal(n)))
    cycle_s = run_s * rng.uniform(1.1, 3.0, n)
    begin, track = rng.random((2, n))
    turn = 2 * np.pi * rng.integers(1, 6, n)
    sticky = rng.uniform(0.3, 0.98, n)
    rcs_m2 = values["rcs_m2"] * shares(rng, n)

    def points(t_s: Array, _antenna_m: Array) -> Points:
        number, now = np.divmod(t_s[:, None] / cycle_s + begin, 1.0)
        share = np.minimum(now * cycle_s / run_s, 1.0)
        fallen = share - sticky * np.sin(turn * share) / turn
        across = (track + _GOLDEN * number) % 1.0 - 0.5
        position_m = sill_m + (across * values["width_m"])[..., None] * right
        position_m[..., 2] += height_m * (1 - fallen)
        return Points(position_m, np.where(share < 1, rcs_m2, 0.0))

    return Thing(numbered("drop", n), points)


RAIN = ThingKind(
    "Rain on a window: many weak drops that run down in fits and starts.",
    {
        "heading_deg": TOWARDS,
        "width_m": Draw(0.1, 6, (0.6, 1.5), "of the pane, m"),
        "height_m": Draw(0.1, 4, (0.6, 1.4), "of the pane, m"),
        "sill_m": Draw(0, 5, (0.7, 1.1), "of its lower edge above the floor, m"),
        "n_drops": Draw(1, 200, (12, 40), "tracks, rounded"),
        "speed_mps": Draw(0.001, 2, (0.02, 0.3), "mean of a drop, m/s", is_log=True),
        "rcs_m2": Draw(1e-9, 1, (1e-4, 1e-2), "of all drops together, m2", is_log=True),
    },
    _rain,
)
