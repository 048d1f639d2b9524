"""Echo engines: from distances and amplitudes to frames, in tiers of one answer.

`frames` picks the cheapest tier that keeps the error asked for: `dense` (every bin of every
scatterer), `local` (the bins that an echo touches) or `gridded` (a coarse grid and one matrix
product).
"""

from x2radar.sim.echo.choose import TIERS, choose, frames
from x2radar.sim.echo.common import Task, echo_sigma_m

__all__ = ["TIERS", "Task", "choose", "echo_sigma_m", "frames"]
