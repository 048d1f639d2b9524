"""Evidence: windows fused over time, while something is there.

A network with a temporal head says itself what windows in their order come to; only the prior is
added, and of hops shorter than `HOP_S` the head gets what it knew about a second before. For any
other, with l the fused log-likelihoods of the classes, p a window's probabilities, r a discount in
proportion to the hop and b a bound (as in a CUSUM): l += r log p; l -= max l; l = max(l, -b);
fused = softmax(l + prior + size). `size` is what the visit's greatest strength says, where an
adult's is known.
"""

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from radard.judge.bundle import EvidenceSettings
from radard.judge.classifier import Answer, Hidden, Probabilities, softmax
from radard.judge.installation import size_nats

HOP_S = 1.0  # stream time from one window to the next, as bundles learned it: half a dwell
_MIN_P = 1e-6  # 14 nats, beyond the usual bound


def windows_a_feed(hop_s: float) -> int:
    """Return how many windows lie between two that the temporal head sees one after the other."""
    return max(1, round(HOP_S / hop_s))


class Evidence:
    """What the windows of one visit say together, `hop_s` apart."""

    def __init__(self, settings: EvidenceSettings, hop_s: float = HOP_S) -> None:
        self._settings = settings
        self._discount = min(1.0, settings.discount * hop_s / HOP_S)
        self._log = np.zeros(3)
        self._strongest_db = -math.inf
        self._hidden: deque[Hidden | None] = deque(maxlen=windows_a_feed(hop_s))

    @property
    def hidden(self) -> Hidden | None:
        """What the temporal head is given with the next window; None before it knows anything."""
        return self._hidden[0] if len(self._hidden) == self._hidden.maxlen else None

    def reset(self) -> None:
        """Forget: nobody is there any more."""
        self._log[:] = 0.0
        self._strongest_db = -math.inf
        self._hidden.clear()

    def fuse(self, answer: Answer, strength_db: float | None = None) -> Probabilities:
        """Take an answer, given `hidden` and the echo over an adult's; return the fused."""
        if strength_db is not None:
            self._strongest_db = max(self._strongest_db, strength_db)
        if answer.fused_log_p is None:
            return self.add(answer.window)
        self._hidden.append(answer.hidden)
        return self._with_prior(answer.fused_log_p)

    def add(self, window: Probabilities) -> Probabilities:
        """Take a window's calibrated probabilities; return the fused ones, sum 1 to 1e-12."""
        s = self._settings
        p = np.array([window.human, window.pet, window.other])
        self._log += self._discount * np.log(np.maximum(p, _MIN_P))
        self._log = np.maximum(self._log - self._log.max(), -s.most)
        known = self._log.copy()
        # A network of two classes does not know the third.
        known[2] = known[2] if window.other > 0 else -math.inf
        return self._with_prior(known)

    def _with_prior(self, log_p: NDArray[np.float64]) -> Probabilities:
        is_known = self._strongest_db > -math.inf
        size = size_nats(self._strongest_db) if is_known else 0.0
        weighed = log_p + np.array([self._settings.prior_human + size, 0.0, 0.0])
        return Probabilities(*(float(p) for p in softmax(weighed)))
