"""Machines that stand in one place: a fan and a washing machine."""

import numpy as np

from x2radar.sim.points import Array, Points
from x2radar.sim.things.draws import (
    HEADING,
    RCS,
    TOWARDS,
    Draw,
    Thing,
    ThingKind,
    Values,
    facing,
    grid,
    lit,
    numbered,
    shares,
)

# Points a blade; rate of tumbling, how long it tumbles, runs up and spins (a washing
# programme in short), and the damping of the drum.
_PER_BLADE = 3
_TUMBLE_HZ = 0.8
_TUMBLE_S, _RAMP_S, _SPIN_S = 12.0, 10.0, 18.0
_DAMPING = 0.2


def _fan(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw blades on a hub, behind a guard that stands still, on a head that may swing.

    Blades give a comb of lines at multiples of the rate of rotation. Each is brightest twice a
    turn: when it stands upright, along the antennas' polarisation, and across the line of
    sight.
    """
    n_blades = round(values["n_blades"])
    pivot_m = np.array([*position_m, values["height_m"]])
    out_m = np.tile(values["radius_m"] * (np.arange(_PER_BLADE) + 1) / _PER_BLADE, n_blades)
    blade = np.repeat(np.arange(n_blades) / n_blades, _PER_BLADE)
    start, swing_turn = rng.random(), rng.random()
    # Real blades are not alike, else the comb would have no lines between.
    alike = 1 + 0.15 * rng.standard_normal(n_blades).clip(-2, 2)
    blades = np.repeat(alike, _PER_BLADE) * np.tile([0.6, 1.0, 1.4], n_blades)
    blade_rcs_m2 = 0.7 * values["rcs_m2"] * blades / blades.sum()
    still_rcs_m2 = 0.3 * values["rcs_m2"] * shares(rng, 2)

    def points(t_s: Array, antenna_m: Array) -> Points:
        head = np.sin(2 * np.pi * (t_s / values["swing_s"] + swing_turn))
        right, ahead = facing(values["heading_deg"] + values["swing_deg"] / 2 * head)
        turn = values["rotation_hz"] * t_s + start
        angle = 2 * np.pi * ((turn[:, None] + blade) % 1.0)
        cos, sin = np.cos(angle)[..., None], np.sin(angle)[..., None]
        along = cos * right[:, None] + sin * np.array([0.0, 0.0, 1.0])
        blade_m = pivot_m + out_m[:, None] * along
        guard_m = pivot_m + 0.1 * ahead[:, None]
        hub_m = np.broadcast_to(pivot_m, guard_m.shape)
        upright = 0.3 + 1.4 * np.sin(angle) ** 2
        aspect = upright * (1 - lit(along, blade_m, antenna_m) ** 2) ** 2
        still = np.tile(still_rcs_m2, (len(t_s), 1))
        return Points(
            np.concatenate([hub_m, guard_m, blade_m], axis=1),
            np.concatenate([still, blade_rcs_m2 * aspect], axis=1),
        )

    return Thing(("hub", "guard", *numbered("blade point", blade.size)), points)


FAN = ThingKind(
    "A fan; its blades give a comb of Doppler lines, its head may swing.",
    {
        "heading_deg": HEADING,
        "height_m": Draw(0, 5, (0.4, 1.4), "of the hub above the floor, m"),
        "radius_m": Draw(0.02, 1.5, (0.1, 0.25), "of the blades, m"),
        "n_blades": Draw(1, 12, (2.51, 6.49), "blades, rounded"),
        "rotation_hz": Draw(0.1, 60, (1, 25), "turns per second, Hz", is_log=True),
        "swing_deg": Draw(0, 180, (0, 90), "from end to end of the head's swing, degrees"),
        "swing_s": Draw(2, 120, (8, 20), "period of the head's swing, s"),
        "rcs_m2": RCS,
    },
    _fan,
)


def drum(t_s: Array, spin_hz: float) -> tuple[Array, Array]:
    """Return a drum's rate in hertz and its turns so far, both of shape (n_slow,).

    It tumbles, runs up to its spin and down again, from the start of a programme.
    """
    ends_s = np.cumsum([_TUMBLE_S, _RAMP_S, _SPIN_S, _RAMP_S])
    cycle, now_s = np.divmod(t_s, ends_s[-1])
    up_s = np.clip(now_s - ends_s[0], 0, _RAMP_S)
    down_s = np.clip(now_s - ends_s[2], 0, _RAMP_S)
    rise = (spin_hz - _TUMBLE_HZ) / _RAMP_S
    hz = _TUMBLE_HZ + rise * (up_s - down_s)
    level_s = np.clip(now_s - ends_s[1], 0, None)
    ramps = rise * (up_s**2 / 2 + _RAMP_S * level_s - down_s**2 / 2)
    in_cycle = _TUMBLE_HZ * ends_s[-1] + rise * _RAMP_S * (_RAMP_S + _SPIN_S)
    return hz, np.asarray(_TUMBLE_HZ * now_s + ramps + cycle * in_cycle)


def _washing_machine(rng: np.random.Generator, position_m: Array, values: Values) -> Thing:
    """Draw a box that shakes.

    The drum hangs on springs: its swing grows with ``(f/f0)^2`` and passes a resonance, the
    answer of a mass on springs to an unbalance.
    """
    across, up = grid(values["width_m"], values["height_m"], 3, 4)
    n = across.size
    right, ahead = facing(values["heading_deg"])
    rest_m = across[:, None] * right + np.array([*position_m, 0.0])
    rest_m[:, 2] += up
    begin_s = rng.uniform(0, _TUMBLE_S + 2 * _RAMP_S + _SPIN_S)
    # Feet on the floor: it rocks, so the top moves most; each point a little otherwise.
    shape = (0.2 + 0.8 * up / values["height_m"])[:, None] * (
        rng.uniform(0.5, 1.0) * ahead
        + rng.uniform(0.2, 0.6) * right
        + 0.1 * rng.standard_normal((n, 3))
    )
    lag_turns = 0.1 * rng.random(n)
    rcs_m2 = values["rcs_m2"] * shares(rng, n)

    def points(t_s: Array, antenna_m: Array) -> Points:
        hz, turns = drum(t_s + begin_s, values["spin_hz"])
        ratio = (hz / values["resonance_hz"]) ** 2
        answer = ratio / np.sqrt((1 - ratio) ** 2 + 4 * _DAMPING**2 * ratio)
        # The greatest answer of this damping is 2.55; the amplitude is that of the peak.
        swing_m = values["amplitude_m"] * (0.1 + 0.9 * answer / 2.55)
        wave = np.sin(2 * np.pi * ((turns[:, None] + lag_turns) % 1.0))
        position_m = rest_m + (swing_m[:, None] * wave)[..., None] * shape
        aspect = 0.3 + 0.7 * lit(ahead, position_m, antenna_m) ** 4
        return Points(position_m, rcs_m2 * aspect)

    return Thing(numbered("front", n), points)


WASHING_MACHINE = ThingKind(
    "A washing machine that tumbles, runs up to its spin and shakes by millimetres.",
    {
        "heading_deg": TOWARDS,
        "width_m": Draw(0.2, 2, (0.4, 0.6), "width, m"),
        "height_m": Draw(0.2, 2, (0.82, 0.9), "height, m"),
        "spin_hz": Draw(1, 40, (8, 20), "rate of the spin, Hz"),
        "resonance_hz": Draw(0.5, 30, (3, 7), "of the drum on its springs, Hz"),
        "amplitude_m": Draw(0, 0.02, (0.0005, 0.004), "greatest swing, m"),
        "rcs_m2": RCS,
    },
    _washing_machine,
)
