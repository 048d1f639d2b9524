"""`x2radar` and `python -m x2radar`."""

import os
import sys

from x2radar.startup import start

# As radard does, before numpy loads: a second thread burns up to three times what the work takes.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")


def main() -> int:
    """Run `x2radar`; return its exit code."""
    return start("x2radar", "x2radar.cli")


if __name__ == "__main__":
    sys.exit(main())
