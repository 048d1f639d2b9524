"""The clock on the wall, which only this module asks: somebody may set it at any moment.

What lasts, is due or is old goes by `time.monotonic` or by order; this is for what people read.
"""

import time
from datetime import UTC, datetime


def now_s() -> float:
    """Return the wall clock's time in seconds since 1970, UTC."""
    return time.time()


def now() -> datetime:
    """Return the time in UTC."""
    return datetime.fromtimestamp(now_s(), UTC)
