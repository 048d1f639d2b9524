"""`python -m x2radar`."""

import sys

from x2radar.cli import main

sys.exit(main())
