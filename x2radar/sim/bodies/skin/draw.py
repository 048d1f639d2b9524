"""Skins by name."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from x2radar.errors import SceneError
from x2radar.sim.bodies.skin.base import ANYBODY, Loudness, Skin
from x2radar.sim.bodies.skin.capsules import CapsuleSkin
from x2radar.sim.bodies.skin.ellipsoids import EllipsoidSkin
from x2radar.sim.bodies.skin.points import PointSkin
from x2radar.sim.bodies.skin.surface import SurfaceSkin

Array = NDArray[np.float64]
Draw = Callable[[np.random.Generator, Array, int, Loudness], Skin]

LARGEST_HALF_M = 1.0
"""No part of a person or pet is 2 m long."""
SKINS: Mapping[str, Draw] = MappingProxyType(
    {
        "surface": lambda rng, half, n, _: SurfaceSkin.draw(rng, half, n_trunk=n),
        "points": lambda rng, half, _, loudness: PointSkin.draw(rng, half, loudness),
        "ellipsoids": lambda rng, half, _, loudness: EllipsoidSkin.draw(rng, half, loudness),
        "capsules": lambda rng, half, _, loudness: CapsuleSkin.draw(rng, half, loudness),
    }
)
"""Every skin: how it is drawn, from half-lengths, the number of trunk segments, the loudness."""


def draw_skin(
    rng: np.random.Generator,
    name: str,
    half_m: ArrayLike,
    n_trunk: int = 1,
    loudness: Loudness = ANYBODY,
) -> Skin:
    """Draw a skin for a body; its scale is the physical one.

    Parameters
    ----------
    rng : numpy.random.Generator
        Everything random comes from it.
    name : str
        A key of `SKINS`.
    half_m : array_like, shape (n_segments, 3)
        Half-lengths of the segments, in metres: along the axis, to the side, across both.
    n_trunk : int
        How many segments, from the first on, are the trunk.
    loudness : Loudness
        How loud the parts are; the surface skin has levels of its own.

    Raises
    ------
    SceneError
        If there is no such skin, or a half-length is not above zero and at most 1 m.
    """
    if name not in SKINS:
        msg = f"skin: no skin '{name}'; known are {', '.join(SKINS)}"
        raise SceneError(msg)
    half = np.array(half_m, dtype=np.float64)
    if half.ndim != 2 or half.shape[1] != 3 or not 0 < n_trunk <= len(half):
        msg = f"half_m: must be (n_segments, 3) with a trunk, not {half.shape} and {n_trunk}"
        raise SceneError(msg)
    if not ((half > 0) & (half <= LARGEST_HALF_M)).all():
        msg = f"half_m: half-lengths must be above 0 and at most {LARGEST_HALF_M:g} m"
        raise SceneError(msg)
    return SKINS[name](rng, half, n_trunk, loudness)
