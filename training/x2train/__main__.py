"""`train-export` and `python -m x2train`."""

import sys

from x2radar.startup import begin


def main() -> int:
    """Run `train-export`; return its exit code."""
    begin()
    # Late: signals are heard before anything else is loaded.
    from x2radar.command import start  # noqa: PLC0415

    return start("train-export", "x2train.cli")


if __name__ == "__main__":
    sys.exit(main())
