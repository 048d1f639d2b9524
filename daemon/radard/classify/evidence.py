"""Evidence: windows fused over time, while something is there.

A network with a temporal head has seen windows in their order and says itself what they come
to; only the leaning is added. For a network without one, windows' probabilities are summed.
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

from radard.classify.classifier import Answer, Hidden, Probabilities, softmax
from radard.errors import ModelMismatch

_LEAST_P = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceSettings:
    """How windows are fused; the optional key `evidence` of a bundle's sidecar.

    Attributes
    ----------
    discount : float
        What a window counts against an independent one, above 0, up to 1; of sums.
    most : float
        No class falls further behind the leading one, in nats; of sums.
    prior_human : float
        Added to the log-likelihood of a person, in nats.
    human_limit : float
        From this fused probability of a person on there is nothing to wait for.
    """

    discount: float = 0.6
    most: float = 5.0
    prior_human: float = 0.0
    human_limit: float = 0.8

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
    """What is known of somebody, window after window.

    Parameters
    ----------
    settings : EvidenceSettings
        From the bundle.
    """

    def __init__(self, settings: EvidenceSettings) -> None:
        self._settings = settings
        self._log = np.zeros(3)
        self.hidden: Hidden | None = None

    def reset(self) -> None:
        """Forget: nobody is there any more."""
        self._log[:] = 0.0
        self.hidden = None

    def take(self, answer: Answer) -> Probabilities:
        """Take what the network says of a window, given `hidden`; return the fused probabilities.

        They are those of its temporal head, leaning as the settings say, or else those of `add`.
        """
        if answer.fused_log_p is None:
            return self.add(answer.window)
        self.hidden = answer.hidden
        return self._leaning(answer.fused_log_p)

    def add(self, window: Probabilities) -> Probabilities:
        """Take a window; return the fused probabilities.

        Parameters
        ----------
        window : Probabilities
            Calibrated; a class of probability 0 in every window stays impossible.

        Returns
        -------
        Probabilities
            They sum to 1 within 1e-12 and depend on the windows since `reset` alone.
        """
        s = self._settings
        p = np.array([window.human, window.pet, window.other])
        self._log += s.discount * np.log(np.maximum(p, _LEAST_P))
        self._log = np.maximum(self._log - self._log.max(), -s.most)
        known = self._log.copy()
        # A network of two classes does not know the third.
        known[2] = known[2] if window.other > 0 else -math.inf
        return self._leaning(known)

    def _leaning(self, log_p: NDArray[np.float64]) -> Probabilities:
        leaning = log_p + np.array([self._settings.prior_human, 0.0, 0.0])
        return Probabilities(*(float(p) for p in softmax(leaning)))
