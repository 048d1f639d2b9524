"""Teachers: a network that is there already shows a smaller one how sure to be.

A label says what was there, not how much of it could be seen: of a body that hardly shows, it
asks for a certainty that nobody has. The probabilities of a larger network, trained on the same
windows, carry that, and a smaller one learns from both (Hinton, Vinyals and Dean, "Distilling
the knowledge in a neural network", 2015, recalled).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from radard.classify.bundle import CLASSES, Bundle
from radard.errors import UsageError
from x2train.nets.bundle_answers import outputs_of

Array = NDArray[np.float32]


def taught_by(bundle: Bundle, windows: Mapping[str, NDArray[Any]]) -> Array:
    """Return what a bundle makes of windows, without any change to them.

    Parameters
    ----------
    bundle : Bundle
        Of three classes, on maps that the windows hold.
    windows : mapping of str to ndarray, shape (n, ...)
        By feature, as `x2train.windows.window_set.load_windows` gives them.

    Returns
    -------
    ndarray, shape (n, 3), float32
        Calibrated probabilities of `CLASSES`.

    Raises
    ------
    UsageError
        If the bundle has other classes, or takes other maps.
    """
    if bundle.classes != CLASSES:
        msg = f"teacher '{bundle.name}': tells {', '.join(bundle.classes)} apart"
        raise UsageError(msg)
    for each in bundle.inputs:
        found = windows[each.feature].shape[1:] if each.feature in windows else None
        if found != each.shape:
            msg = (
                f"teacher '{bundle.name}': takes {each.feature} of shape {each.shape}, not {found}"
            )
            raise UsageError(msg)
    answers = outputs_of(bundle.onnx, {i.name: windows[i.feature] for i in bundle.inputs})
    return answers.p(bundle.temperature).astype(np.float32)


def taught_error(
    answers: torch.Tensor,
    labels: torch.Tensor,
    taught: torch.Tensor,
    *,
    share: float,
    weight: torch.Tensor,
) -> torch.Tensor:
    """Return the cross-entropy with labels and teacher, every class weighing as `weight` says.

    Parameters
    ----------
    answers : Tensor, shape (n, 3), float32
        Logits.
    labels : Tensor, shape (n,), int64
        Classes.
    taught : Tensor, shape (n, 3), float32
        The teacher's probabilities.
    share : float
        What the teacher counts; the label counts the rest.
    weight : Tensor, shape (3,), float32
        Of windows of each class, whoever says what they are.
    """
    wanted = share * taught
    wanted[torch.arange(len(labels)), labels] += 1 - share
    each = -(wanted * answers.log_softmax(1)).sum(1)
    return (each * weight[labels]).sum() / weight[labels].sum()
