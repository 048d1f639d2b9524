"""`train-export` and `python -m x2train`."""

import sys

from x2radar.startup import start


def main() -> int:
    """Run `train-export`; return its exit code."""
    return start("train-export", "x2train.cli")


if __name__ == "__main__":
    sys.exit(main())
