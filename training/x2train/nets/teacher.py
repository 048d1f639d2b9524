"""Distillation: a smaller network learns from labels and from a larger network's probabilities.

A label says what was there, not how much of it could be seen; the probabilities of a larger
network, trained on the same windows, carry that (Hinton, Vinyals and Dean, "Distilling the
knowledge in a neural network", 2015, recalled).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from radard.errors import UsageError
from radard.judge.bundle import CLASSES, Bundle
from x2train.nets.bundle_answers import outputs_of
from x2train.sets.window_set import inputs_of

Array = NDArray[np.float32]


def taught_by(bundle: Bundle, windows: Mapping[str, NDArray[Any]]) -> Array:
    """Return a bundle's calibrated probabilities of windows by feature, shape (n, 3)."""
    if bundle.classes != CLASSES:
        raise UsageError(f"teacher '{bundle.name}': tells {', '.join(bundle.classes)} apart")
    for each in bundle.inputs:
        found = windows[each.feature].shape[1:] if each.feature in windows else None
        if found != each.shape:
            raise UsageError(
                f"teacher '{bundle.name}': takes {each.feature} of shape {each.shape}, not {found}"
            )
    answers = outputs_of(bundle.onnx, inputs_of(bundle, windows))
    return answers.p(bundle.temperature).astype(np.float32)


def taught_error(
    answers: torch.Tensor,
    labels: torch.Tensor,
    taught: torch.Tensor,
    *,
    share: float,
    weight: torch.Tensor,
) -> torch.Tensor:
    """Return the cross-entropy of logits, (n, 3), with labels and, by `share`, a teacher."""
    wanted = share * taught
    wanted[torch.arange(len(labels)), labels] += 1 - share
    each = -(wanted * answers.log_softmax(1)).sum(1)
    return (each * weight[labels]).sum() / weight[labels].sum()
