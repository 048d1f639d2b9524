"""The gridded tier: echoes on a coarse grid, then one matrix product to the bins.

A Gaussian is the convolution of two narrower ones. Echoes are spread with the first on a
grid as coarse as the band allows, about 0.8 sigma instead of 12 bins a sigma; the second
is a matrix, the same for every block of bins (`design`). So an echo touches 9 points
instead of 90 bins, and the bins cost a product that runs at the speed of BLAS. (The split
is that of the fast Gauss transform and of Gaussian-gridding non-uniform FFTs: Dutt &
Rokhlin 1993, Greengard & Lee 2004; recalled.)
"""

from x2radar.frame import FastTimeAxis
from x2radar.sim.echo.common import Amplitude, Array, Frames, Pulse, blocks, check, empty
from x2radar.sim.echo.design import design_for
from x2radar.sim.echo.spread import spread


def frames(
    range_m: Array,
    amplitude: Amplitude,
    axis: FastTimeAxis,
    pulse: Pulse | None = None,
    *,
    error_db: float = -60.0,
    floor: float = 0.0,
) -> Frames:
    """Return frames by way of a coarse grid; see `choose.FramesOf`.

    The error is over the sum of the amplitudes of the echoes near the bin; further than about
    18 sigma from an echo it is exactly zero. Raises SceneError, too, where the axis' bins are
    longer than a third of the pulse's sigma.
    """
    check(range_m, amplitude)
    design = design_for(axis, pulse or Pulse.of(axis), error_db)
    out = empty(len(range_m), axis)
    for part in blocks(*range_m.shape):
        echo = spread(range_m[part], amplitude[part], axis, design.grid, floor)
        design.write(echo, out[part])
    return out
