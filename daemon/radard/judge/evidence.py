"""Evidence: windows fused over time, while something is there.

A network with a temporal head has seen windows in their order and says itself what they come
to; only the prior is added. For a network without one, windows' probabilities are summed.
Overlapping windows of one body say much the same, so each counts with a discount only. The sum
is bounded, as in a CUSUM: a pet that was there for minutes does not outvote the person who
comes in after it for longer than a few windows.

With l the fused log-likelihoods of the classes, p a window's probabilities, r the discount
and b the bound::

    l += r log p;   l -= max l;   l = max(l, -b);   fused = softmax(l + prior)
"""

import math

import numpy as np
from numpy.typing import NDArray

from radard.judge.bundle import EvidenceSettings
from radard.judge.classifier import Answer, Hidden, Probabilities, softmax

_MIN_P = 1e-6  # 14 nats, beyond the usual bound


class Evidence:
    """What is known of somebody, window after window."""

    def __init__(self, settings: EvidenceSettings) -> None:
        self._settings = settings
        self._log = np.zeros(3)
        self.hidden: Hidden | None = None

    def reset(self) -> None:
        """Forget: nobody is there any more."""
        self._log[:] = 0.0
        self.hidden = None

    def fuse(self, answer: Answer) -> Probabilities:
        """Take what the network says of a window, given `hidden`; return the fused probabilities.

        They are those of its temporal head, with the prior of the settings, or else those of
        `add`.
        """
        if answer.fused_log_p is None:
            return self.add(answer.window)
        self.hidden = answer.hidden
        return self._with_prior(answer.fused_log_p)

    def add(self, window: Probabilities) -> Probabilities:
        """Take a window's calibrated probabilities; return the fused ones.

        They sum to 1 within 1e-12 and depend on the windows since `reset` alone. A class of
        probability 0 in every window stays impossible.
        """
        s = self._settings
        p = np.array([window.human, window.pet, window.other])
        self._log += s.discount * np.log(np.maximum(p, _MIN_P))
        self._log = np.maximum(self._log - self._log.max(), -s.most)
        known = self._log.copy()
        # A network of two classes does not know the third.
        known[2] = known[2] if window.other > 0 else -math.inf
        return self._with_prior(known)

    def _with_prior(self, log_p: NDArray[np.float64]) -> Probabilities:
        weighed = log_p + np.array([self._settings.prior_human, 0.0, 0.0])
        return Probabilities(*(float(p) for p in softmax(weighed)))
