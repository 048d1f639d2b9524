"""What trainings make small, and how inputs are scaled."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from x2train.thesis.mlp import probabilities

_SPARSE_TO = 0.05  # as usual for sparse autoencoders
TYPE1 = 784  # 28 x 28: M times I alpha


def scaling_of(
    x: NDArray[np.float32], how: str, n_type1: int = TYPE1
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return what is taken from every input, and the factor on it; see `FitSettings`.

    Inputs that never change count 0 with 'each'; its factors are at most ten times the
    median's, or bins that are nearly always empty would be blown up.
    """
    mean, scale = np.zeros(x.shape[1]), np.ones(x.shape[1])
    if how == "each":
        mean = x.mean(axis=0, dtype=np.float64)
        sd = x.std(axis=0, dtype=np.float64)
        floor = 0.1 * np.median(sd[sd > 0]) if (sd > 0).any() else 1.0
        scale = np.where(sd > 0, 1 / np.maximum(sd, floor), 0.0)
    elif how == "block":
        for part in (slice(0, -n_type1), slice(-n_type1, None)):
            power = np.mean(np.square(x[:, part], dtype=np.float64)) if x[:, part].size else 0.0
            scale[part] = power**-0.5 if power > 0 else 1.0
    return mean.astype(np.float32), scale.astype(np.float32)


def output_error(logits: torch.Tensor, y: torch.Tensor, kind: str) -> torch.Tensor:
    """Return the sum over repeats of the mean error, 'cross-entropy' or 'mse'.

    Logits have shape (n_repeats, n, n_outputs), classes `y` (n,), int64.
    """
    n = len(y)
    if kind == "mse":
        wanted = functional.one_hot(y, 2).to(logits.dtype)
        return (probabilities(logits) - wanted).square().sum() / (2 * n)
    if logits.shape[-1] == 1:
        human = y.to(logits.dtype).expand(logits.shape[:-1])
        total = functional.binary_cross_entropy_with_logits(logits[..., 0], human, reduction="sum")
        return total / n
    flat = logits.reshape(-1, 2)
    return functional.cross_entropy(flat, y.repeat(len(logits)), reduction="sum") / n


def code_penalty(codes: torch.Tensor, activation: str) -> torch.Tensor:
    """Return the sum over repeats of the sparsity penalty on codes (n_repeats, n, size)."""
    if activation == "relu":
        return codes.abs().mean(dim=(1, 2)).sum()
    mean = codes.mean(dim=1)
    mean = (mean + 1) / 2 if activation == "tanh" else mean
    mean = mean.clamp(1e-6, 1 - 1e-6)
    rho = _SPARSE_TO
    kl = rho * torch.log(rho / mean) + (1 - rho) * torch.log((1 - rho) / (1 - mean))
    return kl.mean(dim=1).sum()
