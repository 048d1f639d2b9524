"""Evidence: windows fused over time, while something is there.

A network with a temporal head says itself what windows in their order come to (of hops shorter
than `HOP_S` it gets what it knew about a second before). For any other, with l the fused
log-likelihoods of the classes, p a window's probabilities, r a discount in proportion to the hop
and b a bound (as in a CUSUM): l += r log p; l -= max l; l = max(l, -b). Then fused =
softmax(l + prior + size + memory): `size` is what the visit's greatest strength says, where an
adult's is known; `memory` what the visit before says, if it ended near by a moment ago: a pet
stands still more often than it goes, so the gate closes, and opens again where it is.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.judge.bundle import EvidenceSettings
from radard.judge.classifier import Answer, Hidden, Probabilities, softmax
from radard.judge.installation import size_nats

HOP_S = 1.0  # stream time from one window to the next, as bundles learned it: half a dwell
_MIN_P = 1e-6  # 14 nats, beyond the usual bound
_SAME, _MEMORY_S, NEAR_M = 0.8, 60.0, 0.5
"""What moves within so much of where a visit ended is the same body with this probability, which
falls by e in so long; docs/evaluation.md has what that wins and costs."""


def windows_a_feed(hop_s: float) -> int:
    """Return how many windows lie between two that the temporal head sees one after the other."""
    return max(1, round(HOP_S / hop_s))


class Evidence:
    """What the windows of one visit say together, `hop_s` apart."""

    def __init__(self, settings: EvidenceSettings, hop_s: float = HOP_S) -> None:
        self._settings = settings
        self._discount = min(1.0, settings.discount * hop_s / HOP_S)
        self._hidden: deque[Hidden | None] = deque(maxlen=windows_a_feed(hop_s))
        self._now: _Seen | None = None
        self._before: _Seen | None = None
        self.end_visit()

    @property
    def hidden(self) -> Hidden | None:
        """What the temporal head is given with the next window; None before it knows anything."""
        return self._hidden[0] if len(self._hidden) == self._hidden.maxlen else None

    def reset(self) -> None:
        """Forget everything."""
        self.end_visit()
        self._before = None

    def end_visit(self) -> None:
        """Start over, since nothing moves any more; what was there is remembered for a while."""
        self._before, self._now = self._now or self._before, None
        self._log = np.zeros(3)
        self._strongest_db = -math.inf
        self._hidden.clear()
        self._memory = 0.0

    def fuse(
        self,
        answer: Answer,
        strength_db: float | None = None,
        *,
        t_s: float = 0.0,
        range_m: float = math.nan,
    ) -> Probabilities:
        """Take an answer, given `hidden`, the echo over an adult's and where; return the fused."""
        if strength_db is not None:
            self._strongest_db = max(self._strongest_db, strength_db)
        if self._now is None:
            self._memory = self._remembered(t_s, range_m)
        if answer.fused_log_p is None:
            made = self.add(answer.window)
        else:
            self._hidden.append(answer.hidden)
            made = self._with_prior(answer.fused_log_p)
        # Without what was remembered itself: visits in a row must not confirm each other.
        own = _logit(made.human) - self._memory
        self._now = _Seen(t_s, range_m, 1 / (1 + math.exp(-own)))
        return made

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
        human = self._settings.prior_human + size + self._memory
        return Probabilities(*(float(p) for p in softmax(log_p + np.array([human, 0.0, 0.0]))))

    def _remembered(self, t_s: float, range_m: float) -> float:
        """Return what the visit before says of one that begins, in nats for a person."""
        before = self._before
        if before is None or not abs(range_m - before.range_m) <= NEAR_M:
            return 0.0
        same = _SAME * math.exp(-(t_s - before.t_s) / _MEMORY_S)
        prior = 1 / (1 + 2 * math.exp(-self._settings.prior_human))
        return _logit(same * before.p_human + (1 - same) * prior) - _logit(prior)


@dataclass(frozen=True, slots=True)
class _Seen:
    """What moved, by the evidence of its visit alone."""

    t_s: float
    range_m: float
    p_human: float


def _logit(p: float) -> float:
    kept = min(max(p, _MIN_P), 1 - _MIN_P)
    return math.log(kept / (1 - kept))
