"""Somebody sets the clock on the wall, by a second to ten years, before a start and while it runs.

    python campaigns/clock.py --steps 200
    python campaigns/clock.py --steps 4      # the short form

A daemon on a simulated module with people in it has all its outputs, an event log, clips and a
limit for them. Its clock on the wall, which one module asks (`x2radar.wall_clock`), is that of the
computer and an offset, drawn for each step; half of them come while it is ended. Its files
get older or newer by the step, as they would. Nothing may go by that clock.

The last line is one JSON object: steps, events, decisions (those compared with a run whose clock
nobody set) and the harm, which gives exit code 1.
"""

import os
import random
import sys
from contextlib import ExitStack, suppress
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from campaigns.kept import BUSY, House, campaign

_DAY_S = 86_400
_STEPS_S = (1, 60, 3600, _DAY_S, 200 * _DAY_S, 366 * _DAY_S, 3653 * _DAY_S)
_CONFIG = {
    **BUSY,
    # Some clips, so that the oldest have to go; the store keeps a day, which no step may end.
    "clips": {"keep_mb": 6, "free_mb": 1, "longest_s": 20, "pre_s": 4},
    "store": {"keep_days": 1},
}


_STEPPED = """
from pathlib import Path
from x2radar import wall_clock
plain, offset = wall_clock.now_s, Path("offset")
def stepped():
    try:
        return plain() + float(offset.read_text())
    except (OSError, ValueError):
        return plain()
wall_clock.now_s = stepped
"""
"""What sets the daemon's clock, by the seconds in a file of its folder."""


class Clock(House):
    """A daemon, and its clock."""

    config = _CONFIG
    before = _STEPPED

    def __init__(self, folder: Path, rng: random.Random, stack: ExitStack) -> None:
        super().__init__(folder, rng, stack)
        self._offset_s = 0
        self.start()
        self.wait_status()

    def once(self, _k: int) -> None:
        """Set the clock."""
        offset_s = self.rng.choice((-1, 1)) * self.rng.choice(_STEPS_S)
        is_at_start = self.rng.random() < 0.5
        if is_at_start:
            self.stop()
        (self.home / "offset.new").write_text(str(offset_s))
        (self.home / "offset.new").rename(self.home / "offset")
        self._age_files(offset_s - self._offset_s)
        self._offset_s = offset_s
        if is_at_start:
            self.start()
            self.wait_status()
        self.alarm_again()
        self.goes_on(self.rng.randint(4, 40), f"{offset_s} s")
        self.expect("silent_stalls", f"{offset_s} s: not online", lambda: self.state_is("online"))
        self.found["lost_states"] += self.daemon.status().get("armed") is not True
        self.look()
        self.look_at_clips()

    def _age_files(self, step_s: float) -> None:
        """Let files be older by a step, or from a time to come."""
        for path in self.home.rglob("*"):
            with suppress(FileNotFoundError):
                about, step_ns = path.stat(), round(step_s * 1e9)
                os.utime(path, ns=(about.st_atime_ns - step_ns, about.st_mtime_ns - step_ns))


if __name__ == "__main__":
    sys.exit(campaign(__doc__, "steps", Clock))
