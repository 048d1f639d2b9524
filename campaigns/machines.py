"""State machines against models: event log, health, panel, ring and calibration, at any length.

    python campaigns/machines.py --steps 1000000
    python campaigns/machines.py --steps 200      # the short form
    python campaigns/machines.py --steps 1000000 log ring

Each is a test that goes a thousand steps in every run. The last line is one JSON object: steps (of
each machine), seconds of each, lost_events (the event log's machine failed), unhandled (others
that did). Exit code 1 if one failed; what it did stands above.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from campaigns.processes import end_with, parser_of
from tests.processes import ROOT

MACHINES = {
    "log": "outputs/test_log_model.py",
    "health": "run/test_health.py::TestHealthMachine",
    "panel": "detect/test_panel_model.py",
    "ring": "detect/test_ring_model.py",
    "calibration": "run/test_calibration_limits.py::TestCalibrationMachine",
}


def failed(name: str, steps: int) -> bool:
    """Let a machine go so many steps; return whether it found what its model has not."""
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, "--show-capture=no", f"tests/{MACHINES[name]}"],
        cwd=ROOT,
        env=os.environ | {"RADARD_STEPS": str(steps)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        print(done.stdout[-6000:], done.stderr[-2000:], sep="\n", file=sys.stderr)
    return done.returncode != 0


def main() -> int:
    """Let all machines go, one after the other."""
    parser = parser_of(__doc__)
    parser.add_argument("machines", nargs="*", choices=[*MACHINES, []], default=[])
    parser.add_argument("--steps", type=int, default=1_000_000)
    args = parser.parse_args()
    found = {"lost_events": 0, "unhandled": 0}
    seconds: dict[str, int] = {}
    for name in args.machines or MACHINES:
        began_s = time.monotonic()
        found["lost_events" if name == "log" else "unhandled"] += failed(name, args.steps)
        seconds[name] = round(time.monotonic() - began_s)
    return end_with({"steps": args.steps, "seconds": seconds, **found})


if __name__ == "__main__":
    sys.exit(main())
