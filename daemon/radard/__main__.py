"""`radard` and `python -m radard`."""

import sys

from x2radar.command import start
from x2radar.startup import hold_back


def main() -> int:
    """Run `radard`; return its exit code."""
    if sys.argv[1:2] and sys.argv[1].startswith("-"):
        # The daemon: before its imports are done, too, these ask it for something.
        hold_back("SIGHUP", "SIGUSR1")
    return start("radard", "radard.cli")


if __name__ == "__main__":
    sys.exit(main())
