"""FrameTiming: when a frame will arrive that has not come yet, from when others did.

Frames come late or in time, never early: they wait in buffers for their reader. So the least
delayed frame of the last two hops, each by its number, says where in time the stream stands;
two hops, because the module's clock and the host's do not run alike.
"""

import math
from collections.abc import Callable


class FrameTiming:
    """Say when a frame is due, by its number."""

    def __init__(self, frame_rate_hz: float) -> None:
        self._rate_hz = frame_rate_hz
        self._lead_s = self._before_s = math.inf

    def note(self, number: int, t_mono_s: float) -> None:
        """Note when a frame arrived, on the host's monotonic clock; 0 is not known."""
        if t_mono_s:
            self._lead_s = min(self._lead_s, t_mono_s - number / self._rate_hz)

    def next_hop(self) -> None:
        """Forget the hop before the last one."""
        self._before_s, self._lead_s = self._lead_s, math.inf

    def reset(self) -> None:
        """Forget everything: the stream has restarted."""
        self._lead_s = self._before_s = math.inf

    def arrival_s(self, number: int) -> float:
        """Return when a frame should arrive, in seconds; infinite while nothing is known."""
        return min(self._lead_s, self._before_s) + number / self._rate_hz


class NextHop:
    """When the frame that completes the next dwell will arrive, once `ask` is called."""

    def __init__(self) -> None:
        # A port is opened before anybody counts its frames.
        self._arrival_s: Callable[[], float] = lambda: math.inf

    def due_s(self) -> float:
        """Return it, on the host's monotonic clock, in seconds; infinite when unknown."""
        return self._arrival_s()

    def ask(self, frame_timing: Callable[[], float]) -> None:
        """Ask `frame_timing` from now on."""
        self._arrival_s = frame_timing
