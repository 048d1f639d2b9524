"""Guises: what makes two bodies of one family unlike each other, beyond what they draw.

Simulated bodies agree in things in which real ones do not: how strong the echo of each part
is, how even the pace. A guise draws these anew, the same way for every class, so that a
network finds nothing to learn there: gains of the parts, cross sections held constant, clocks
that run fast, slow and unevenly, overall strength.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.antenna import length_m
from x2radar.sim.cast import Actor
from x2radar.sim.points import Label, Mover, Points

Array = NDArray[np.float64]
_LONGEST_LOOK_S = 40.0
_LOOK_STEP_S = 0.1
_N_WAVES = 4


@dataclass(frozen=True, slots=True, eq=False)
class Guise:
    """A mover made less like the others of its kind; a `Mover` itself.

    Attributes
    ----------
    mover : Mover
        Who it is.
    gain : ndarray, shape (n_points,), float64
        Factors on the cross sections.
    is_constant : bool
        Cross sections keep their mean over the asked times.
    begin_s, pace : float
        Its own time is ``begin_s + pace t`` and what `wave` adds.
    wave : ndarray, shape (3, n_waves), float64
        Amplitude in seconds, frequency in Hz and phase of the unevenness of its clock.
    """

    mover: Mover
    gain: Array
    is_constant: bool
    begin_s: float
    pace: float
    wave: Array

    @property
    def label(self) -> Label:
        """That of the mover."""
        return self.mover.label

    @property
    def names(self) -> tuple[str, ...]:
        """Those of the mover."""
        return self.mover.names

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return its points; see `Mover`."""
        size_s, rate_hz, phase = self.wave[:, None]
        uneven = (size_s * np.sin(2 * np.pi * rate_hz * t_s[:, None] + phase)).sum(axis=1)
        points = self.mover.at(self.begin_s + self.pace * t_s + uneven, antenna_m)
        rcs = points.rcs_m2 * self.gain
        if self.is_constant:
            rcs = np.broadcast_to(rcs.mean(axis=0), rcs.shape)
        return Points(points.position_m, rcs)


@dataclass(frozen=True, slots=True)
class GuisedActor(Actor):
    """An actor who comes in a guise.

    Attributes
    ----------
    antenna_m : tuple of float
        Where the antenna is.
    swath_m : tuple of float
        Near and far end of what the radar sees.
    lead_s : tuple of float
        It enters the swath so many seconds after time 0, drawn evenly.
    is_plain : bool
        Without guise, but for its entry: bodies as their own files make them.
    """

    antenna_m: tuple[float, float, float] = (0.0, 0.0, 1.0)
    swath_m: tuple[float, float] = (0.6, 3.4)
    lead_s: tuple[float, float] = (0.2, 2.5)
    is_plain: bool = False

    def make(self, rng: np.random.Generator) -> Mover:
        """Return it with new draws; raises SceneError as `read_actor`."""
        # The zero-argument super() does not work in a slotted dataclass.
        mover = Actor.make(self, rng)
        n = len(mover.names)
        spread_db, share, z = rng.uniform(0, 5), rng.random(4), rng.standard_normal(n + 1)
        gain = 10 ** (spread_db * z[1:].clip(-2, 2) / 10)
        gain /= gain.mean()
        pace = float(np.exp(0.10 * z[0].clip(-2, 2)))
        rate_hz = 0.15 * 8 ** rng.random(_N_WAVES)
        # The clock never stops: the sum of the rates' swings stays under a third.
        size_s = share[0] * 0.08 / (2 * np.pi * rate_hz)
        if self.is_plain:
            gain, pace, size_s = np.ones(n), 1.0, 0 * size_s
        wave = np.array([size_s, rate_hz, 2 * np.pi * rng.random(_N_WAVES)])
        constant = not self.is_plain and bool(share[1] < 0.2)
        begin_s = self._begin_s(mover, share[2], share[3]) if self.lead_s[1] >= 0 else 0.0
        return Guise(mover, gain, constant, begin_s, pace, wave)

    def _begin_s(self, mover: Mover, where: float, lead: float) -> float:
        """Return when to begin, so that it comes into the swath soon or is in it."""
        t_s = np.arange(0.0, _LONGEST_LOOK_S, _LOOK_STEP_S)
        antenna_m = np.array(self.antenna_m)
        range_m = length_m(mover.at(t_s, antenna_m).position_m - antenna_m)
        seen = ((range_m > self.swath_m[0]) & (range_m < self.swath_m[1])).mean(axis=1) > 0.3
        times = t_s[seen]
        if not len(times):
            return 0.0
        # Half the time at its entry, else anywhere on its way.
        start = times[0] if where < 0.5 else times[int((2 * where - 1) * (len(times) - 1))]
        early, late = self.lead_s
        return float(start - early - (late - early) * lead)
