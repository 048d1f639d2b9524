"""The campaigns find no harm in their short forms: `python tools/checks/harm.py`."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "daemon"), str(ROOT / "training")]

from campaigns.fuzz_targets import TARGETS  # noqa: E402 - the path comes first
from campaigns.processes import HARM  # noqa: E402
from tests.processes import environ  # noqa: E402

SHORT = {
    "faults": "--runs 22 --injected 2 --surroundings reload_broken,two_daemons",
    "kill": "--kills 3",
    "soak": "--minutes 0.2 --stream-hours 0.01",
    "clock": "--steps 3",
    "disk": "--faults 6",
    "fuzz": "--inputs 40 --keep FOUND",
}
DID: dict[str, Callable[[Any], bool]] = {
    "faults": lambda found: found["runs"] == 26 and found["kinds"]["virtual"]["lost"] > 100,
    "kill": lambda found: found["kills"] == 3 and found["events"] > 0,
    "soak": lambda found: all(run["decisions"] > 3 for run in found["runs"].values()),
    "clock": lambda found: found["steps"] == 3 and found["events"] > 0,
    "disk": lambda found: len(found["faults"]) + len(found["skipped"]) == 6,
    "fuzz": lambda found: found["inputs"] == 40 * len(TARGETS),
}
"""What each tells of itself in its last line when it has done so much."""


def harm(name: str) -> Iterator[str]:
    """Yield what a campaign has found, or has left undone."""
    with tempfile.TemporaryDirectory() as folder:
        kept = Path(folder) / "found"
        words = SHORT[name].replace("FOUND", str(kept)).split()
        argv = [sys.executable, str(ROOT / f"campaigns/{name}.py"), *words]
        given = {"capture_output": True, "text": True, "timeout": 1200, "env": environ()}
        done = subprocess.run(argv, cwd=ROOT, check=False, **given)  # type: ignore[call-overload]
        found = json.loads((done.stdout.splitlines() or ["{}"])[-1])
        if done.returncode or any(found.get(key) != 0 for key in HARM) or kept.exists():
            yield f"{name}: {found} {done.stderr}"
        elif not DID[name](found):
            yield f"{name}: has not done all: {found}"


def main() -> int:
    """Print what was found in the campaigns that are named, or all; return 1 if anything was."""
    names = sys.argv[1:] or list(SHORT)
    found = [line for name in names for line in harm(name)]
    for line in found:
        print(line)
    print(f"campaigns: {len(names)} in their short forms, {len(found)} complaints")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
