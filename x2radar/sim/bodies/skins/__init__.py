"""Skins: how the segments of a body echo, whatever moves them.

Four laws, none of which is the truth, so that a network cannot learn one of them by heart:

    surface      ellipsoids with a trunk of one bright spot (`surface`)
    points       constant scatterers along the segments, with drawn weights (`points`)
    ellipsoids   ellipsoids by physical optics, each by itself, aspect-dependent (`surface`)
    capsules     cylinders with round ends, and shadows of what lies before them (`capsules`)

Each takes poses and gives `Points`; all fluctuation is a function of the aspect alone.
"""

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from x2radar.keys import Key
from x2radar.sim.bodies.skins.base import THEORY, EchoGain, Skin
from x2radar.sim.bodies.skins.capsules import CapsuleSkin
from x2radar.sim.bodies.skins.points import PointSkin
from x2radar.sim.bodies.skins.surface import SurfaceSkin
from x2radar.sim.points import Array, Pose

TotalRcs = float | Literal["physical"] | None
"""Mean total of a body: in dBsm, by its sizes, or None for a draw of its own."""

TOTAL_RCS_DBSM = (-15.0, 3.0)  # from a cat end-on to a large man: holds both, whatever the body is
_TINY_M2 = 1e-12
SKINS: Mapping[str, Callable[[np.random.Generator, Array, int, EchoGain], Skin]] = {
    "surface": lambda rng, half, n, _: SurfaceSkin(rng, half, n),
    "points": lambda rng, half, _, gain: PointSkin(rng, half, gain),
    "ellipsoids": lambda rng, half, _, gain: SurfaceSkin(rng, half, 1, gain),
    "capsules": lambda rng, half, _, gain: CapsuleSkin(rng, half, gain),
}
"""Every skin: how it is drawn, from half-lengths, the number of trunk segments, the gains."""


def draw_skin(
    rng: np.random.Generator,
    name: str,
    half_m: ArrayLike,
    n_trunk: int = 1,
    gain: EchoGain = THEORY,
) -> Skin:
    """Draw a skin of `SKINS` for parts of half-lengths (n_segments, 3); or SceneError."""
    Key(choices=tuple(SKINS)).judge(name, "skin")
    return SKINS[name](rng, np.array(half_m, dtype=np.float64), n_trunk, gain)


def sized(skin: Skin, rng: np.random.Generator, total_rcs_dbsm: TotalRcs, pose: Pose) -> Skin:
    """Return a new skin, its mean total over a pose set; SceneError outside -70 to 30 dBsm."""
    # Were people larger than pets, a classifier would learn size instead of movement.
    total_m2 = float(10.0 ** (rng.uniform(*TOTAL_RCS_DBSM) / 10.0))
    if total_rcs_dbsm == "physical":
        return skin
    if total_rcs_dbsm is not None:
        Key(-70.0, 30.0).judge(total_rcs_dbsm, "total_rcs_dbsm")
        total_m2 = 10.0 ** (total_rcs_dbsm / 10.0)
    side = np.broadcast_to(pose.side, pose.axis.shape)
    mean_m2 = skin.mean_total_m2(Pose(pose.centre_m, pose.axis, side))
    skin.scale *= total_m2 / max(mean_m2, _TINY_M2)
    return skin
