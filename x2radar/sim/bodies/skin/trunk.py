"""The trunk as one surface with one bright spot.

A body is drawn with several ellipsoids for its trunk, because chest, belly and hips, or chest,
barrel and rump, are of different girth. To the radar they are one smooth convex surface, and
high-frequency backscatter of a smooth convex body comes from one place, where it is nearest to
the antenna (stationary phase; Ruck, Radar Cross Section Handbook, 1970, recalled). The spot
slides over the surface as the body turns and sways. It carries the mean power of all the
ellipsoids, less what roughness scatters from each place by itself.
"""

import numpy as np
from numpy.typing import NDArray

from x2radar.sim.points import Points

Array = NDArray[np.float64]

BLEND_M = 0.011
"""Depth within which parts of the surface answer together: the first Fresnel zone is a quarter
of a wavelength deep, 11 mm at 6.8 GHz."""
_TINY = 1e-300
"""For parts without an echo, which weigh nothing."""


def one_surface(
    points: Points,
    parts: slice,
    still_m2: Array,
    floor_m2: Array,
    antenna_m: Array,
) -> Points:
    """Return points of a body with its trunk as one bright spot and weak places about it.

    `still_m2`, shape (n_slow, n_points), is without fluctuation: the spot must not wander when
    an echo glints. `floor_m2`, shape (n_points,), is what roughness gives in any view; no more
    stays with the other `parts`. The sum of cross sections is the same at every time. The spot,
    at the first of the parts, is so much nearer than its middle as the nearest surface is;
    where two are equally near, between them.
    """
    assert points.nearer_m is not None  # noqa: S101 - SurfaceSkin gives it
    first = parts.start
    rcs, nearer_m = points.rcs_m2.copy(), points.nearer_m.copy()
    still = np.maximum(still_m2[:, parts], _TINY)
    towards_m = antenna_m - points.position_m[:, parts]
    away_m = np.sqrt((towards_m**2).sum(axis=-1))
    range_m = away_m - nearer_m[:, parts]
    weight = still * np.exp((range_m.min(axis=1, keepdims=True) - range_m) / BLEND_M)
    spot_m = (weight * range_m).sum(axis=1) / weight.sum(axis=1)
    nearer_m[:, first] = np.maximum(away_m[:, 0] - spot_m, 0.0)
    total = rcs[:, parts].sum(axis=1)
    rcs[:, parts] *= np.minimum(floor_m2[parts] / still, 1.0)
    rcs[:, first] = total - rcs[:, first + 1 : parts.stop].sum(axis=1)
    return Points(points.position_m, rcs, nearer_m)
