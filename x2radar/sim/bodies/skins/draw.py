"""Skins by name, drawn for a body and made as strong as it shall be."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from x2radar.sim.bodies.checks import check_name, check_number
from x2radar.sim.bodies.pose import Pose
from x2radar.sim.bodies.skins.base import THEORY, EchoGain, Skin
from x2radar.sim.bodies.skins.capsules import CapsuleSkin
from x2radar.sim.bodies.skins.ellipsoids import EllipsoidSkin
from x2radar.sim.bodies.skins.points import PointSkin
from x2radar.sim.bodies.skins.surface import SurfaceSkin
from x2radar.sim.points import Array

TotalRcs = float | Literal["physical"] | None
"""Mean total cross section of a body: in dBsm, 'physical' for what the segments' sizes give, or
None for a draw that does not depend on the body."""

TOTAL_RCS_DBSM = (-15.0, 3.0)
"""From a cat end-on to a large man: holds both, whatever the body is."""
_TINY_M2 = 1e-12
SKINS: Mapping[str, Callable[[np.random.Generator, Array, int, EchoGain], Skin]] = {
    "surface": lambda rng, half, n, _: SurfaceSkin.draw(rng, half, n),
    "points": lambda rng, half, _, gain: PointSkin.draw(rng, half, gain),
    "ellipsoids": lambda rng, half, _, gain: EllipsoidSkin.draw(rng, half, gain),
    "capsules": lambda rng, half, _, gain: CapsuleSkin.draw(rng, half, gain),
}
"""Every skin: how it is drawn, from half-lengths, the number of trunk segments, the gains."""


def draw_skin(
    rng: np.random.Generator,
    name: str,
    half_m: ArrayLike,
    n_trunk: int = 1,
    gain: EchoGain = THEORY,
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
    gain : EchoGain, optional
        How strong the parts are; the surface skin has levels of its own.

    Raises
    ------
    SceneError
        If there is no such skin.
    """
    check_name("skin", name, SKINS, "skin")
    return SKINS[name](rng, np.array(half_m, dtype=np.float64), n_trunk, gain)


def sized(skin: Skin, rng: np.random.Generator, total_rcs_dbsm: TotalRcs, pose: Pose) -> Skin:
    """Return the same skin with another mean total cross section over a pose.

    One number is drawn, used or not: the choice changes nothing drawn later. Raises SceneError
    if `total_rcs_dbsm` is a number outside -70 to 30.
    """
    total_m2 = draw_total_m2(rng)
    if total_rcs_dbsm == "physical":
        return skin
    if total_rcs_dbsm is not None:
        check_number("total_rcs_dbsm", total_rcs_dbsm, -70.0, 30.0)
        total_m2 = 10.0 ** (total_rcs_dbsm / 10.0)
    side = np.broadcast_to(pose.side, pose.axis.shape)
    mean_m2 = skin.mean_total_m2(Pose(pose.centre_m, pose.axis, side))
    return replace(skin, scale=skin.scale * (total_m2 / max(mean_m2, _TINY_M2)))


def draw_total_m2(rng: np.random.Generator) -> float:
    """Draw a body's mean total cross section, whatever the body is.

    Were people larger than pets, a classifier would learn size instead of movement.
    """
    return float(10.0 ** (rng.uniform(*TOTAL_RCS_DBSM) / 10.0))
