"""`radard` and `python -m radard`."""

import signal
import sys

from x2radar.startup import start


def main() -> int:
    """Run `radard`; return its exit code."""
    if sys.argv[1:2] and sys.argv[1].startswith("-"):
        # The daemon heeds them once it can, see `radard.run.os_signals`.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP, signal.SIGUSR1})
    return start("radard", "radard.cli")


if __name__ == "__main__":
    sys.exit(main())
