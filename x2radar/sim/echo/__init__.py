"""Echo engines: from distances and amplitudes to frames, in tiers of one answer; see `choose`."""

from x2radar.sim.echo.choose import TIERS, choose, frames
from x2radar.sim.echo.common import Task, echo_sigma_m

__all__ = ["TIERS", "Task", "choose", "echo_sigma_m", "frames"]
