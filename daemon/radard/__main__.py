"""`python -m radard`."""

import sys

from radard.cli import main

sys.exit(main())
