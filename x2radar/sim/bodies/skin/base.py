"""The contract of a skin, and the size of its echo."""

from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from x2radar.errors import SceneError
from x2radar.sim.points import Points

Array = NDArray[np.float64]
TotalRcs = float | Literal["physical"] | None

SKIN_REFLECTION = 0.54
"""Power reflection of skin and muscle at 7 GHz (Gabriel's tissue data, recalled)."""
WAVELENGTH_M = 0.044
"""At 6.8 GHz, the X2's carrier."""
TOTAL_RCS_DBSM = (-15.0, 3.0)
"""From a cat end-on to a large man: chosen to hold both, whatever the body is."""
_FAR_M = 50.0
_N_AZIMUTHS = 24
_TINY_M2 = 1e-12
_SPREAD_DB = 4.0
"""Most that parts' own draws spread in `draw_gain` (chosen)."""


@dataclass(frozen=True, slots=True)
class Loudness:
    """How loud the parts of a kind of body are against theory; every body draws its own.

    Recorded people show stronger limbs than single bodies of theory have, a recorded dog weaker
    paws (docs/research/evaluation-tried.md). Values are chosen.
    """

    most_power: float = 0.5
    """Large parts lose to small ones by up to so much of their ratio."""
    losses: tuple[tuple[tuple[int, ...], float], ...] = ()
    """Groups of parts, by number, and the most that each group loses, in dB."""

    def draw(self, rng: np.random.Generator, n_segments: int) -> Array:
        """Draw the factors of the groups' losses, shape (n_segments,)."""
        factor = np.ones(n_segments)
        for parts, most_db in self.losses:
            factor[list(parts)] *= 10 ** (-rng.uniform(0.0, most_db) / 10)
        return factor


ANYBODY = Loudness()


def draw_gain(rng: np.random.Generator, size: Array, loudness: Loudness) -> Array:
    """Draw what segments echo against theory, shape (n_segments,), mean weighted by size 1.

    `size` is what theory gives. Besides `loudness` each part has a draw of its own of up to 4 dB.
    """
    power, spread = rng.uniform(0.0, loudness.most_power), rng.uniform(0.0, _SPREAD_DB)
    noise = 10 ** (spread / 10 * rng.standard_normal(len(size)).clip(-2, 2))
    gain = (size / size.max()) ** -power * noise * loudness.draw(rng, len(size))
    return np.asarray(gain * (size.sum() / (size * gain).sum()))


class Skin(Protocol):
    """How the segments of one body echo; everything random was drawn when it was made."""

    @property
    def scale(self) -> float:
        """Factor on all cross sections."""
        ...

    def names(self, parts: tuple[str, ...], /) -> tuple[str, ...]:
        """Return the names of its points, from those of the segments."""
        ...

    def points(self, centre_m: Array, axis: Array, side: Array, antenna_m: Array, /) -> Points:
        """Return the echoes of postures.

        Parameters
        ----------
        centre_m : ndarray, shape (n_slow, n_segments, 3), float64
            Middles of the segments, in room coordinates.
        axis : ndarray, shape (n_slow, n_segments, 3), float64
            Unit vectors along the segments.
        side : ndarray, shape (n_slow, n_segments or 1, 3), float64
            Unit vectors square to the axes, to the body's left. Segments that are round about
            their axis do not care.
        antenna_m : ndarray, shape (3,), float64
            Where the antenna is.

        Returns
        -------
        Points
            As many as `names` has.
        """
        ...

    def mean_total_m2(self, centre_m: Array, axis: Array, side: Array, /) -> float:
        """Return the sum of all cross sections, averaged over aspect and the given postures.

        Square metres, seen level from far away, every azimuth weighing the same.
        """
        ...


_S = TypeVar("_S", bound=Any)


def sized(
    skin: _S,
    rng: np.random.Generator,
    total_rcs_dbsm: TotalRcs,
    posture: tuple[Array, Array, Array],
) -> _S:
    """Return the same skin with another mean total cross section.

    Parameters
    ----------
    skin : Skin
        A dataclass with a `scale`.
    rng : numpy.random.Generator
        One number is drawn, used or not: the choice changes nothing drawn later.
    total_rcs_dbsm : float, 'physical' or None
        What `mean_total_m2` shall be, in decibels over a square metre; 'physical' leaves what the
        segments' sizes give, None draws as `draw_total_m2` does.
    posture : tuple of ndarray
        Middles, axes and side vectors to average over, as `Skin.points` takes them.

    Raises
    ------
    SceneError
        If `total_rcs_dbsm` is a number outside -70 to 30.
    """
    total_m2 = draw_total_m2(rng)
    if total_rcs_dbsm == "physical":
        return skin
    if total_rcs_dbsm is not None:
        if not -70.0 <= total_rcs_dbsm <= 30.0:
            msg = f"total_rcs_dbsm: {total_rcs_dbsm} is not in -70 to 30"
            raise SceneError(msg)
        total_m2 = 10.0 ** (total_rcs_dbsm / 10.0)
    centre, axis, side = posture
    mean_m2 = skin.mean_total_m2(centre, axis, np.broadcast_to(side, axis.shape))
    factor = total_m2 / max(mean_m2, _TINY_M2)
    made: _S = replace(skin, scale=skin.scale * factor)
    return made


def draw_total_m2(rng: np.random.Generator, dbsm: tuple[float, float] = TOTAL_RCS_DBSM) -> float:
    """Draw a body's mean total cross section, whatever the body is.

    Were people larger than pets, a classifier would learn size instead of movement.
    """
    return float(10.0 ** (rng.uniform(*dbsm) / 10.0))


def mean_over_azimuths(skin: Skin, centre_m: Array, axis: Array, side: Array) -> float:
    """Return `Skin.mean_total_m2` by looking from all sides."""
    middle = centre_m.mean(axis=(0, 1))
    totals = []
    for turn in np.arange(_N_AZIMUTHS) * (2 * np.pi / _N_AZIMUTHS):
        antenna = middle + _FAR_M * np.array([np.cos(turn), np.sin(turn), 0.0])
        totals.append(skin.points(centre_m, axis, side, antenna).rcs_m2.sum(axis=1).mean())
    return float(np.mean(totals))


def seen_from(centre_m: Array, axis: Array, side: Array, antenna_m: Array) -> tuple[Array, Array]:
    """Return where the antenna is in the segments' own axes, and how far.

    Returns
    -------
    seen : ndarray, shape (n_slow, n_segments, 3), float64
        Unit vectors: along the segment, to its side, across both.
    distance_m : ndarray, shape (n_slow, n_segments), float64
        At least a nanometre: a segment in the antenna itself is seen from some side or other.
    """
    towards = antenna_m - centre_m
    distance = np.maximum(np.sqrt((towards * towards).sum(axis=-1)), 1e-9)
    unit = towards / distance[..., None]
    left = np.broadcast_to(side, axis.shape)
    ways = (axis, left, np.cross(axis, left))
    return np.stack([(unit * way).sum(axis=-1) for way in ways], axis=-1), distance
