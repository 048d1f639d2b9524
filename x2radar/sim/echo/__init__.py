"""Echo engines: from distances and amplitudes to frames, in tiers of one answer.

All tiers take the same arguments and give the same frames within a stated error:
`passband` (the reference), `dense` (every bin of every scatterer), `local` (the bins that
an echo touches), `gridded` (a coarse grid and one matrix product) and `spectral` (the
frequency domain, also without any frames). `frames` picks the cheapest.
"""

from x2radar.sim.echo.choose import TIERS, Task, Tier, TierName, choose, frames
from x2radar.sim.echo.common import Pulse
from x2radar.sim.echo.noise import NoiseColour, noise_colour
from x2radar.sim.echo.spectral import spectrum
from x2radar.sim.echo.spectral_grid import SpectralGrid

__all__ = [
    "TIERS",
    "NoiseColour",
    "Pulse",
    "SpectralGrid",
    "Task",
    "Tier",
    "TierName",
    "choose",
    "frames",
    "noise_colour",
    "spectrum",
]
