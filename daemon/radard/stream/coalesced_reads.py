"""Coalesced reads: a stream's bytes are left to collect, so that one wake-up takes many.

While a stream flows, reading pauses for `PAUSE_S`. Replies to commands never wait, and neither
does the frame that completes a dwell: people wait for the decision.
"""

import math
import time
from collections.abc import Callable

from x2radar.device.transport import Transport
from x2radar.errors import TransportClosed

PAUSE_S = 0.04  # at 614 kB/s (X2 RF, 200 Hz) 25 kB collect; a kernel's buffer holds 64
_FLOWS_BYTES = 512  # in a read: more than any reply to a command
_EARLY_S = 0.006  # more than a due frame was ever early: `FrameTiming` errs by less
_LATE_S = 0.1  # a frame that late is lost
# A Linux terminal gives at most 4095 bytes to a read, whatever waits behind them: a read of
# about that many is followed by another one at once.
_FULL_BYTES = range(4000, 4097)
_MAX_READS = 16  # in a row: 64 kB, all that a kernel's buffer holds


class CoalescedReads:
    """A transport that is read less often."""

    def __init__(
        self,
        inner: Transport,
        *,
        due_s: Callable[[], float] = lambda: math.inf,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self._inner = inner
        self._due_s = due_s
        self._clock = clock
        self._sleep = sleep
        self._next_s = 0.0
        self.is_usb = bool(getattr(inner, "is_usb", False))
        self.write, self.close = inner.write, inner.close

    def read(self, timeout_s: float) -> bytes:
        """Read from the inner transport; once a stream was found, only after the pause."""
        if (wait_s := self._wait_s()) > 0:
            self._sleep(wait_s)
        data = part = self._inner.read(timeout_s)
        for _ in range(_MAX_READS):
            if len(part) not in _FULL_BYTES:
                break
            try:
                part = self._inner.read(timeout_s)
            except TransportClosed:
                # What was read counts; the next read meets the end again.
                break
            data += part
        flows = len(data) >= _FLOWS_BYTES
        self._next_s = self._clock() + PAUSE_S if flows else 0.0
        return data

    def _wait_s(self) -> float:
        now_s = self._clock()
        if (left_s := self._next_s - now_s) <= 0:
            return 0.0
        to_due_s = self._due_s() - now_s
        # One that does not come is lost; then nothing is gained by looking all the time.
        return min(left_s, max(0.0, to_due_s - _EARLY_S)) if to_due_s > -_LATE_S else left_s
