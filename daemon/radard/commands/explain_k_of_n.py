"""K of N for `radard explain` alone: what it does to error rates and to the delay.

It decides nothing; `radard.alarm.panel` does. Two cases bound what happens: every window is a
draw of its own, or all windows of one pass fare alike. Real windows overlap and lie in between.
"""

from collections.abc import Iterator
from itertools import islice


def alarm_by_window(p_hit: float, k: int, n: int) -> Iterator[float]:
    """Yield the probability that K of N have been hits by the first, second, ... window."""
    keep = (1 << (n - 1)) - 1
    pending = {0: 1.0}
    done = 0.0
    while True:
        following: dict[int, float] = {}
        for history, p in pending.items():
            with_hit = history << 1 | 1
            if with_hit.bit_count() >= k:
                done += p * p_hit
            else:
                following[with_hit & keep] = following.get(with_hit & keep, 0.0) + p * p_hit
            without = history << 1 & keep
            following[without] = following.get(without, 0.0) + p * (1 - p_hit)
        pending = following
        yield min(done, 1.0)


def alarm_probability(p_hit: float, k: int, n: int, n_windows: int) -> float:
    """Return the probability of an alarm within `n_windows` independent windows."""
    return next(islice(alarm_by_window(p_hit, k, n), n_windows - 1, None))


def windows_until(share: float, p_hit: float, k: int, n: int, *, most: int = 120) -> int | None:
    """Return after how many windows a share of all passes has alarmed; None beyond `most`."""
    for count, p in enumerate(islice(alarm_by_window(p_hit, k, n), most), 1):
        if p >= share:
            return count
    return None
