"""Domain randomization: bodies of one family differ in more than what the simulator draws.

Gains of the parts, trunks of one bright spot or of several, constant cross sections, uneven
clocks: the same way for every class, so that a network finds nothing to learn there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.bodies.body import Body
from x2radar.sim.bodies.skins import SurfaceSkin
from x2radar.sim.place.antenna import length_m
from x2radar.sim.points import Label, Mover, Points
from x2radar.sim.scene.cast import Actor

Array = NDArray[np.float64]
_LONGEST_LOOK_S = 40.0  # courses are shorter
_LOOK_STEP_S = 0.1  # a tenth of a step
_GOES_MPS = 0.15  # slower bodies stay
_MIN_WAY_S = 1.0  # half a dwell of going
_N_WAVES = 4  # uneven, but smooth
_CONTRAST = (0.35, 1.3)  # exponent on the parts' strengths, chosen: limbs are recorded stronger
_JOINED = 0.25  # of the strongest part: -6 dB
_JOIN_SHARE, _CONSTANT_SHARE, _LOOSE_SHARE = 0.25, 0.3, 0.4  # of bodies


@dataclass(frozen=True, slots=True, eq=False)
class DomainRandomization:
    """A mover made less like the others of its kind; a `Mover` itself."""

    mover: Mover
    label: Label  # of the body inside, as the names of its parts
    names: tuple[str, ...]
    gain: Array
    contrast: float
    joins: bool
    is_constant: bool
    begin_s: float
    pace: float
    wave: Array

    def at(self, t_s: Array, antenna_m: Array) -> Points:
        """Return the body's points by an uneven clock, with gains of its own; see `Mover`."""
        size_s, rate_hz, phase = self.wave[:, None]
        uneven = (size_s * np.sin(2 * np.pi * rate_hz * t_s[:, None] + phase)).sum(axis=1)
        points = self.mover.at(self.begin_s + self.pace * t_s + uneven, antenna_m)
        rcs = points.rcs_m2 * self.gain
        mean = rcs.mean(axis=0)
        top = float(mean.max(initial=0.0))
        if top > 0:
            factor = (np.maximum(mean, 1e-6 * top) / top) ** (self.contrast - 1)
            # The whole is as strong as before.
            rcs *= factor * (mean.sum() / (mean * factor).sum())
        if self.is_constant:
            rcs = np.broadcast_to(rcs.mean(axis=0), rcs.shape)
        points = Points(points.position_m, rcs, points.nearer_m)
        return _joined(points) if self.joins and top > 0 else points


def _joined(points: Points) -> Points:
    """Return points whose strongest parts are one, in their middle, with their echoes' sum."""
    mean = points.rcs_m2.mean(axis=0)
    strong = np.flatnonzero(mean > _JOINED * mean.max())
    weight = mean[strong] / mean[strong].sum()
    first, rest = strong[0], strong[1:]
    position_m, rcs = points.position_m.copy(), points.rcs_m2.copy()
    position_m[:, first] = np.einsum("k,tkx->tx", weight, position_m[:, strong])
    rcs[:, first] = rcs[:, strong].sum(axis=1)
    rcs[:, rest] = 0.0
    nearer_m = points.nearer_m
    if nearer_m is not None:
        nearer_m = nearer_m.copy()
        nearer_m[:, first] = nearer_m[:, strong] @ weight
    return Points(position_m, rcs, nearer_m)


@dataclass(frozen=True, slots=True)
class RandomizedActor(Actor):
    """An actor who comes in a randomization."""

    antenna_m: tuple[float, float, float] = (0.0, 0.0, 1.0)  # where the antenna is
    swath_m: tuple[float, float] = (0.6, 3.4)  # near and far end of what the radar sees
    # it enters the swath so many seconds after time 0, drawn evenly
    lead_s: tuple[float, float] = (0.2, 2.5)
    # without randomization, but for its entry: bodies as their own files make them
    is_plain: bool = False

    def make(self, rng: np.random.Generator) -> Mover:
        """Return it with new draws; raises SceneError as `read_actor`."""
        # The zero-argument super() does not work in a slotted dataclass.
        mover = Actor.make(self, rng)
        n = len(mover.names)
        spread_db, share, z = rng.uniform(0, 5), rng.random(7), rng.standard_normal(n + 1)
        is_loose = share[6] < _LOOSE_SHARE and not self.is_plain
        if is_loose and isinstance(mover, Body) and isinstance(mover.skin, SurfaceSkin):
            mover.skin.n_trunk = 1  # it was drawn just now, for nobody else
        gain = 10 ** (spread_db * z[1:].clip(-2, 2) / 10)
        gain /= gain.mean()
        pace = float(np.exp(0.10 * z[0].clip(-2, 2)))
        rate_hz = 0.15 * 8 ** rng.random(_N_WAVES)
        # The clock never stops: the sum of the rates' swings stays under a third.
        size_s = share[0] * 0.08 / (2 * np.pi * rate_hz)
        contrast = _CONTRAST[0] + (_CONTRAST[1] - _CONTRAST[0]) * share[4]
        joins, constant = bool(share[5] < _JOIN_SHARE), bool(share[1] < _CONSTANT_SHARE)
        if self.is_plain:
            gain, pace, size_s = np.ones(n), 1.0, 0 * size_s
            contrast, joins, constant = 1.0, False, False
        wave = np.array([size_s, rate_hz, 2 * np.pi * rng.random(_N_WAVES)])
        begin_s = self._begin_s(mover, share[2], share[3]) if self.lead_s[1] >= 0 else 0.0
        inside = (mover, mover.label, mover.names)
        return DomainRandomization(*inside, gain, contrast, joins, constant, begin_s, pace, wave)

    def _begin_s(self, mover: Mover, where: float, lead: float) -> float:
        """Return when to begin, so that it comes into the swath soon or is in it."""
        t_s = np.arange(0.0, _LONGEST_LOOK_S, _LOOK_STEP_S)
        antenna_m = np.array(self.antenna_m)
        place_m = mover.at(t_s, antenna_m).position_m
        range_m = length_m(place_m - antenna_m)
        seen = ((range_m > self.swath_m[0]) & (range_m < self.swath_m[1])).mean(axis=1) > 0.3
        times = t_s[seen]
        if not len(times):
            return 0.0
        step_m = np.linalg.norm(np.diff(place_m.mean(axis=1), axis=0), axis=1)
        goes = step_m > _GOES_MPS * _LOOK_STEP_S
        if goes.any():
            # Who has arrived stands there for good: that is not on its way.
            on_the_way = times[times <= t_s[np.flatnonzero(goes)[-1]] - _MIN_WAY_S]
            times = on_the_way if len(on_the_way) else times[:1]
        # Half the time at its entry, else anywhere on its way.
        start = times[0] if where < 0.5 else times[int((2 * where - 1) * (len(times) - 1))]
        early, late = self.lead_s
        return float(start - early - (late - early) * lead)
