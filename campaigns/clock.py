"""Somebody sets the clock on the wall, by a second to ten years, before a start and while it runs.

    python campaigns/clock.py --steps 200
    python campaigns/clock.py --steps 4      # the short form

A daemon on a simulated module with people in it has all its outputs, an event log, clips and a
limit for them. Its clock on the wall, which one module asks (`x2radar.wall_clock`), is that of the
computer and an offset, drawn for each step; half of them come while it is ended. Its files
get older or newer by the step, as they would. Nothing may go by that clock.

The last line is one JSON object: steps; events; decisions (those compared); lost_events (not at
every output, or deleted from the store by a step); duplicate_events (a number, a key or a row used
twice); unreadable (a clip that an event names and that is not there, while an older one is);
lost_states (no longer armed); silent_stalls (no decision, or not online, after a step);
decisions_differ (from a run whose clock nobody set); crashes. Exit code 1 if harm was found.
"""

import os
import random
import sys
import tempfile
from pathlib import Path

_ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(_ROOT), str(_ROOT / "daemon")]

from campaigns.kept import PORT, Kept, alarm_again, reference  # noqa: E402 - below the path
from campaigns.outputs import Broker, Outputs  # noqa: E402
from campaigns.processes import CONFIG, STEPPED, Daemon, end_with, parser_of, wait_for  # noqa: E402

_DAY_S = 86_400
_STEPS_S = (1, 60, 3600, _DAY_S, 200 * _DAY_S, 366 * _DAY_S, 3653 * _DAY_S)
_CONFIG = {
    **CONFIG,
    # Stream seconds a second: more happens between two steps.
    "sensor": {"port": PORT, "speed": "4"},
    # Some clips, so that the oldest have to go; the store keeps a day, which no step may end.
    "clips": {"keep_mb": 6, "free_mb": 1, "longest_s": 20, "pre_s": 4},
    "store": {"keep_days": 1},
}


class Clock:
    """A daemon, its clock, and what it kept over the steps."""

    def __init__(self, folder: Path, broker: Broker, rng: random.Random) -> None:
        self._home, self._rng = folder / "radard", rng
        self._home.mkdir()
        self._offset_s = 0
        self._outputs = Outputs(folder, broker)
        self.kept = Kept(self._outputs, self._home / "state")
        self.found = dict.fromkeys(("crashes", "silent_stalls", "lost_states"), 0)
        self._daemon = self._started()

    def step(self) -> None:
        """Set the clock once."""
        offset_s = self._rng.choice((-1, 1)) * self._rng.choice(_STEPS_S)
        is_at_start = self._rng.random() < 0.5
        if is_at_start:
            self.stop()
        (self._home / "offset.new").write_text(str(offset_s))
        (self._home / "offset.new").rename(self._home / "offset")
        self._age_files(offset_s - self._offset_s)
        self._offset_s = offset_s
        if is_at_start:
            self._daemon = self._started()
        try:
            self._goes_on()
        except TimeoutError as err:
            self.found["silent_stalls"] += 1
            print(f"{offset_s} s: {err}: {self._daemon.status()}", file=sys.stderr)
        self.found["lost_states"] += self._daemon.status().get("armed") is not True
        self.kept.look()
        self.kept.look_at_clips(self._daemon.log)

    def finish(self) -> int:
        """Let all events arrive; return how many there were."""
        self.kept.found["lost_events"] += self._outputs.lost()
        self.kept.look()
        self.stop()
        return len(self._outputs.kept())

    def stop(self) -> None:
        """End the daemon."""
        code = self._daemon.stop()
        if code != 0 or "Traceback" in self._daemon.log:
            self.found["crashes"] += 1
            print(f"ended with {code}: {self._daemon.log[-2000:]}", file=sys.stderr)

    def _started(self) -> Daemon:
        daemon = Daemon(self._home, *self._outputs.arguments, config=_CONFIG, before=STEPPED)
        # The file of the one before is still there.
        pid = daemon.process.pid
        wait_for(lambda: daemon.status().get("pid") == pid or not daemon.is_alive, "a status")
        return daemon

    def _goes_on(self) -> None:
        alarm_again(self._daemon)
        first = self._n_told()
        n = self._rng.randint(4, 40)
        wait_for(lambda: self._n_told() >= first + n, f"{n} decisions")
        self._daemon.wait_state("online")

    def _n_told(self) -> int:
        return sum(1 for _ in self._outputs.records("decision"))

    def _age_files(self, step_s: float) -> None:
        """Let files be older by a step, or from a time to come."""
        for path in self._home.rglob("*"):
            try:
                about = path.stat()
                step_ns = round(step_s * 1e9)
                os.utime(path, ns=(about.st_atime_ns - step_ns, about.st_mtime_ns - step_ns))
            except FileNotFoundError:
                continue


def main() -> int:
    """Set the clock again and again."""
    parser = parser_of(__doc__)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    rng = random.Random(args.seed)  # noqa: S311 - no secret
    with tempfile.TemporaryDirectory() as made, Broker(Path(made)) as broker:
        folder = Path(made)
        expected = reference(folder, _CONFIG, 60 if args.steps < 10 else 600)
        clock = Clock(folder, broker, rng)
        try:
            for _ in range(args.steps):
                clock.step()
            events = clock.finish()
        finally:
            clock.stop()
        decisions = clock.kept.look_at_decisions(expected)
    counts = {"steps": args.steps, "events": events, "decisions": decisions}
    return end_with({**counts, **clock.found, **clock.kept.found})


if __name__ == "__main__":
    sys.exit(main())
