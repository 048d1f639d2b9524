"""Vibration of the antenna's own mount: everything that stands still moves, and alike.

It is no `Mover`: it gives a displacement that is added to the antenna's place, for moving
points (`Antenna.direct`) and for the static room (`Room.echo`).
"""

import math

import numpy as np

from x2radar.sim.points import Array
from x2radar.sim.things.draws import Draw, Gust, Values, values_of

_DECAY_S = 0.2
"""Of a shock: a bracket rings for some swings."""
DRAWS = {
    "hum_hz": Draw(1, 200, (5, 30), "of the bracket, Hz"),
    "hum_m": Draw(0, 0.005, (1e-5, 3e-4), "greatest swing, m"),
    "shock_m": Draw(0, 0.01, (0, 1e-3), "swing at a shock, m"),
    "shock_s": Draw(0.1, 3600, (1, 20), "between shocks, s"),
    "sway_m": Draw(0, 0.01, (0, 5e-4), "slow sway, m"),
}


class MountVibration:
    """A displacement of the antenna over time.

    Three axes, each with its own share: a hum that swells and fades, a slow sway, and
    shocks, each a burst at the bracket's frequency that dies away in 0.2 s. Shocks come
    one in each interval, at a moment within it that a golden section gives.
    """

    def __init__(self, rng: np.random.Generator, values: Values) -> None:
        self._hz = values["hum_hz"]
        self._hum_m, self._shock_m = values["hum_m"], values["shock_m"]
        self._every_s, self._sway_m = values["shock_s"], values["sway_m"]
        direction = rng.standard_normal((3, 3))
        self._direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        self._turn, self._moment = rng.random(2)
        self._swell, self._sway = Gust(rng, 0.02, 0.5), Gust(rng, 0.05, 0.3)

    def offset_m(self, t_s: Array) -> Array:
        """Return how far the antenna is off its place, shape (n_slow, 3), in metres.

        Times may come in any order; shocks that overlap add up.
        """
        hum_m = self._hum_m * self._swell.at(t_s)
        hum_m *= np.sin(2 * np.pi * ((self._hz * t_s + self._turn) % 1.0))
        sway_m = self._sway_m * (2 * self._sway.at(t_s) - 1)
        return np.asarray(np.stack([hum_m, sway_m, self._shocks(t_s)], axis=1) @ self._direction)

    def _shocks(self, t_s: Array) -> Array:
        out = np.zeros(len(t_s))
        number = np.floor(t_s / self._every_s)
        # A shock still rings in the intervals after its own, for ten times its decay.
        for back in range(math.ceil(10 * _DECAY_S / self._every_s) + 1):
            n = number - back
            moment = (self._moment + 0.618_033_988_749_895 * n) % 1.0
            since_s = np.maximum(t_s - (n + moment) * self._every_s, 0.0)
            ring = np.sin(2 * np.pi * self._hz * since_s) * np.exp(-since_s / _DECAY_S)
            out += self._shock_m * ring
        return out


def draw_mount(
    rng: np.random.Generator, raw: Values | None = None, where: str = "mount"
) -> MountVibration:
    """Return a mount that vibrates; what `raw` leaves out of `DRAWS` is drawn.

    Raises SceneError if `raw` holds anything unknown or impossible.
    """
    return MountVibration(rng, values_of(rng, DRAWS, raw, where))
