"""The clock on the wall, which only this module asks: somebody may set it at any moment.

What lasts, is due or is old goes by `time.monotonic` or by order; this is for what people read.
"""

import time
from datetime import UTC, datetime


def now_s() -> float:
    """Return the wall clock's time in seconds since 1970, UTC."""
    return time.time()


def parse_utc(text: str) -> datetime | None:
    """Return the time of an ISO 8601 text, UTC unless it says so; None of none from 1970 on."""
    try:
        when = datetime.fromisoformat(text)
        when = when.replace(tzinfo=when.tzinfo or UTC).astimezone(UTC)
    except (ValueError, OverflowError):
        return None
    return when if 1970 <= when.year < 9000 else None


def now() -> datetime:
    """Return the time in UTC."""
    return datetime.fromtimestamp(now_s(), UTC)


def utc_text(when: datetime | None = None, timespec: str = "milliseconds") -> str:
    """Return a UTC time, now by default, as ISO 8601 text with a Z."""
    return (when or now()).isoformat(timespec=timespec).replace("+00:00", "Z")
