"""Our programs in processes of their own, as a user starts them."""

import os
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def environ(**more):
    """Variables of a process that finds the packages of this checkout first."""
    roots = (str(ROOT / name) for name in (".", "daemon", "training"))
    return {**os.environ, "PYTHONPATH": os.pathsep.join(roots), **more}


def ran(*argv, **options):
    """What came of a Python with these arguments: its exit code, what it has said."""
    given = {"capture_output": True, "text": True, "timeout": 600, "env": environ(), **options}
    check = given.pop("check", False)
    return subprocess.run([sys.executable, *map(str, argv)], check=check, **given)


def started(*argv, **options):
    """A Python with these arguments that runs, with pipes for what it says."""
    given = {**dict.fromkeys(("stdout", "stderr"), subprocess.PIPE), "env": environ(), **options}
    return subprocess.Popen([sys.executable, *map(str, argv)], **given)


def hears_sigterm(pid: int) -> bool:
    status = Path(f"/proc/{pid}/status").read_text()
    (caught,) = [line.split()[1] for line in status.splitlines() if line.startswith("SigCgt")]
    return bool(int(caught, 16) >> (signal.SIGTERM - 1) & 1)
