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
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.errors import ModelMismatch
from radard.judge.classifier import Answer, Hidden, Probabilities, softmax

_LEAST_P = 1e-6  # chosen: 14 nats, beyond the usual bound


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceSettings:
    """How windows are fused; the optional key `evidence` of a bundle's sidecar."""

    discount: float = 0.6  # what a window counts against an independent one; of sums
    most: float = 5.0  # nats that no class falls further behind the leading one; of sums
    prior_human: float = 0.0  # nats added to the log-likelihood of a person
    human_limit: float = 0.8  # from this fused p(human) on there is nothing to wait for

    @classmethod
    def from_mapping(cls, raw: Mapping[str, Any]) -> "EvidenceSettings":
        """Read the settings of a sidecar; raise ModelMismatch on an unknown or wrong one."""
        limits = {
            "discount": (1e-3, 1.0),
            "most": (1.4, 50.0),
            "prior_human": (-10.0, 10.0),
            "human_limit": (0.2, 1.0),
        }
        known = [f.name for f in fields(cls)]
        for key, value in raw.items():
            if key not in known:
                msg = f"evidence.{key}: unknown setting; this radard is too old for the bundle"
                raise ModelMismatch(msg)
            low, high = limits[key]
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                msg = f"evidence.{key}: {value!r} is not a number"
                raise ModelMismatch(msg)
            if not low <= value <= high:
                msg = f"evidence.{key}: {value} is not from {low:g} to {high:g}"
                raise ModelMismatch(msg)
        return cls(**raw)


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
        self._log += s.discount * np.log(np.maximum(p, _LEAST_P))
        self._log = np.maximum(self._log - self._log.max(), -s.most)
        known = self._log.copy()
        # A network of two classes does not know the third.
        known[2] = known[2] if window.other > 0 else -math.inf
        return self._with_prior(known)

    def _with_prior(self, log_p: NDArray[np.float64]) -> Probabilities:
        weighed = log_p + np.array([self._settings.prior_human, 0.0, 0.0])
        return Probabilities(*(float(p) for p in softmax(weighed)))
