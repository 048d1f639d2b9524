"""Pet-immune radar alarm: the service. Read `radard.pipeline` first."""

import os

# One thread for matrix products, set before numpy loads: the matrices here are small, and a
# second thread only burns another core while it waits for work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
