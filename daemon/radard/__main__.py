"""`radard` and `python -m radard`."""

import sys

from x2radar.command import start


def main() -> int:
    """Run `radard`; return its exit code."""
    return start("radard", "radard.cli")


if __name__ == "__main__":
    sys.exit(main())
