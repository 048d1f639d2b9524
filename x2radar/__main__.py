"""`x2radar` and `python -m x2radar`."""

import sys

from x2radar.command import start


def main() -> int:
    """Run `x2radar`; return its exit code."""
    return start("x2radar", "x2radar.cli")


if __name__ == "__main__":
    sys.exit(main())
