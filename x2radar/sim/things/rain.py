"""Rain on a window: drops that run down, stop and go."""

import numpy as np

from x2radar.sim.points import Label, Points
from x2radar.sim.things.draws import TOWARDS, Array, Draw, ThingKind, Values, facing

# Successive drops of one track start where a golden section takes them: never twice alike.
_GOLDEN = 0.618_033_988_749_895


class RainOnWindow:
    """Tracks on a pane; on each, one drop after another runs down and then rests.

    A drop moves by ``s - b sin(2 pi m s) / (2 pi m)`` of its way with s even in time: it
    never runs up, and for b near 1 almost stops m times.
    """

    label: Label = "other"

    def __init__(self, rng: np.random.Generator, position_m: Array, values: Values) -> None:
        n = round(values["n_drops"])
        self.names = tuple(f"drop {k + 1}" for k in range(n))
        self._sill_m = np.array([*position_m, values["sill_m"]])
        self._right, _ = facing(values["heading_deg"])
        self._width_m, self._height_m = values["width_m"], values["height_m"]
        speed_mps = values["speed_mps"] * np.exp(0.5 * rng.standard_normal(n))
        self._run_s = self._height_m / speed_mps
        self._cycle_s = self._run_s * rng.uniform(1.1, 3.0, n)
        self._begin, self._across = rng.random((2, n))
        self._stops = rng.integers(1, 6, n)
        self._sticky = rng.uniform(0.3, 0.98, n)
        strength = rng.exponential(size=n)
        self._rcs_m2 = values["rcs_m2"] * strength / strength.sum()

    def at(self, t_s: Array, antenna_m: Array) -> Points:  # noqa: ARG002 - of the protocol
        """Return its points. A resting track has no cross section."""
        number, now = np.divmod(t_s[:, None] / self._cycle_s + self._begin, 1.0)
        share = np.minimum(now * self._cycle_s / self._run_s, 1.0)
        turn = 2 * np.pi * self._stops
        fallen = share - self._sticky * np.sin(turn * share) / turn
        across = (self._across + _GOLDEN * number) % 1.0 - 0.5
        position_m = self._sill_m + (across * self._width_m)[..., None] * self._right
        position_m[..., 2] += self._height_m * (1 - fallen)
        return Points(position_m, np.where(share < 1, self._rcs_m2, 0.0))


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
    RainOnWindow,
)
