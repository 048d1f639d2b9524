"""Machines that stand in one place: a fan and a washing machine."""

import numpy as np

from x2radar.sim.points import Label, Points
from x2radar.sim.things.draws import (
    HEADING,
    RCS,
    TOWARDS,
    Array,
    Draw,
    ThingKind,
    Values,
    facing,
    grid,
    lit,
    shares,
)

# Points a blade; rate of tumbling, how long it tumbles, runs up and spins (a washing
# programme in short), and the damping of the drum.
_PER_BLADE = 3
_TUMBLE_HZ = 0.8
_TUMBLE_S, _RAMP_S, _SPIN_S = 12.0, 10.0, 18.0
_DAMPING = 0.2


class Fan:
    """Blades on a hub, behind a guard that stands still, on a head that may swing.

    Blades give a comb of lines at multiples of the rate of rotation. Each is brightest twice a
    turn: when it stands upright, along the antennas' polarisation, and across the line of
    sight.
    """

    label: Label = "other"

    def __init__(self, rng: np.random.Generator, position_m: Array, values: Values) -> None:
        n_blades = round(values["n_blades"])
        self.names = (
            "hub",
            "guard",
            *(f"blade {b + 1}.{k + 1}" for b in range(n_blades) for k in range(_PER_BLADE)),
        )
        self._hub_m = np.array([*position_m, values["height_m"]])
        out = values["radius_m"] * (np.arange(_PER_BLADE) + 1) / _PER_BLADE
        self._out_m = np.tile(out, n_blades)
        self._blade = np.repeat(np.arange(n_blades) / n_blades, _PER_BLADE)
        self._turn = rng.random()
        self._rotation_hz = values["rotation_hz"]
        self._heading_deg = values["heading_deg"]
        self._swing_deg, self._swing_hz = values["swing_deg"], 1 / values["swing_s"]
        self._swing_turn = rng.random()
        # Real blades are not alike, else the comb would have no lines between.
        alike = 1 + 0.15 * rng.standard_normal(n_blades).clip(-2, 2)
        blades = np.repeat(alike, _PER_BLADE) * np.tile([0.6, 1.0, 1.4], n_blades)
        self._blade_rcs_m2 = 0.7 * values["rcs_m2"] * blades / blades.sum()
        self._still_rcs_m2 = 0.3 * values["rcs_m2"] * shares(rng, 2)

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points."""
        head = np.sin(2 * np.pi * (self._swing_hz * t_s + self._swing_turn))
        right, ahead = facing(self._heading_deg + self._swing_deg / 2 * head)
        turn = self._rotation_hz * t_s + self._turn
        angle = 2 * np.pi * ((turn[:, None] + self._blade) % 1.0)
        cos, sin = np.cos(angle)[..., None], np.sin(angle)[..., None]
        up = np.array([0.0, 0.0, 1.0])
        along = cos * right[:, None] + sin * up
        blade_m = self._hub_m + self._out_m[:, None] * along
        guard_m = self._hub_m + 0.1 * ahead[:, None]
        hub_m = np.broadcast_to(self._hub_m, guard_m.shape)
        upright = 0.3 + 1.4 * np.sin(angle) ** 2
        aspect = upright * (1 - lit(along, blade_m, antenna_m) ** 2) ** 2
        still = np.tile(self._still_rcs_m2, (len(t_s), 1))
        return Points(
            np.concatenate([hub_m, guard_m, blade_m], axis=1),
            np.concatenate([still, self._blade_rcs_m2 * aspect], axis=1),
        )


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
    Fan,
)


class WashingMachine:
    """A box that shakes: slow tumbling, then a run-up to the spin and down again.

    The drum hangs on springs: its swing grows with ``(f/f0)^2`` and passes a resonance, the
    answer of a mass on springs to an unbalance.
    """

    label: Label = "other"

    def __init__(self, rng: np.random.Generator, position_m: Array, values: Values) -> None:
        across, up = grid(values["width_m"], values["height_m"], 3, 4)
        n = across.size
        self.names = tuple(f"front {k + 1}" for k in range(n))
        right, self._ahead = facing(values["heading_deg"])
        self._rest_m = across[:, None] * right + np.array([*position_m, 0.0])
        self._rest_m[:, 2] += up
        self._spin_hz, self._own_hz = values["spin_hz"], values["resonance_hz"]
        self._amplitude_m = values["amplitude_m"]
        self._begin_s = rng.uniform(0, _TUMBLE_S + 2 * _RAMP_S + _SPIN_S)
        # Feet on the floor: it rocks, so the top moves most; each point a little otherwise.
        rocks = 0.2 + 0.8 * up / values["height_m"]
        self._shape = rocks[:, None] * (
            rng.uniform(0.5, 1.0) * self._ahead
            + rng.uniform(0.2, 0.6) * right
            + 0.1 * rng.standard_normal((n, 3))
        )
        self._lag_turns = 0.1 * rng.random(n)
        self._rcs_m2 = values["rcs_m2"] * shares(rng, n)

    def rotation(self, t_s: Array) -> tuple[Array, Array]:
        """Return the drum's rate in hertz and its turns so far, both of shape (n_slow,)."""
        ends_s = np.cumsum([_TUMBLE_S, _RAMP_S, _SPIN_S, _RAMP_S])
        cycle, now_s = np.divmod(t_s + self._begin_s, ends_s[-1])
        up_s = np.clip(now_s - ends_s[0], 0, _RAMP_S)
        down_s = np.clip(now_s - ends_s[2], 0, _RAMP_S)
        rise = (self._spin_hz - _TUMBLE_HZ) / _RAMP_S
        hz = _TUMBLE_HZ + rise * (up_s - down_s)
        level_s = np.clip(now_s - ends_s[1], 0, None)
        ramps = rise * (up_s**2 / 2 + _RAMP_S * level_s - down_s**2 / 2)
        in_cycle = _TUMBLE_HZ * ends_s[-1] + rise * _RAMP_S * (_RAMP_S + _SPIN_S)
        return hz, np.asarray(_TUMBLE_HZ * now_s + ramps + cycle * in_cycle)

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points."""
        hz, turns = self.rotation(t_s)
        ratio = (hz / self._own_hz) ** 2
        answer = ratio / np.sqrt((1 - ratio) ** 2 + 4 * _DAMPING**2 * ratio)
        # The greatest answer of this damping is 2.55; the amplitude is that of the peak.
        swing_m = self._amplitude_m * (0.1 + 0.9 * answer / 2.55)
        wave = np.sin(2 * np.pi * ((turns[:, None] + self._lag_turns) % 1.0))
        position_m = self._rest_m + (swing_m[:, None] * wave)[..., None] * self._shape
        aspect = 0.3 + 0.7 * lit(self._ahead, position_m, antenna_m) ** 4
        return Points(position_m, self._rcs_m2 * aspect)


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
    WashingMachine,
)
