"""`python -m x2train`."""

import sys

from x2train.cli import main

sys.exit(main())
