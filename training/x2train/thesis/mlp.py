"""The thesis' network Q-100-50-2, many initial weights at once.

All repeats share one tensor a layer, so that a step costs one product for all of them; they
meet nowhere else: the loss is a sum over repeats, and optimisers work element by element.
"""

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

_SPARSE_TO = 0.05  # as usual for sparse autoencoders
ACTIVATIONS: dict[str, type[nn.Module]] = {"relu": nn.ReLU, "sigmoid": nn.Sigmoid, "tanh": nn.Tanh}


def xavier(shape: tuple[int, ...], generator: torch.Generator) -> torch.Tensor:
    """Return weights of shape (..., n_in, n_out), uniform within sqrt(6 / (n_in + n_out))."""
    bound = (6.0 / (shape[-2] + shape[-1])) ** 0.5
    weights: torch.Tensor = (torch.rand(shape, generator=generator) * 2 - 1) * bound
    return weights


class RepeatedMlp(nn.Module):
    """A feed-forward network with bias, in `n_repeats` versions, drawn as Xavier's."""

    def __init__(
        self, n_repeats: int, sizes: tuple[int, ...], activation: str, *, seed: int
    ) -> None:
        super().__init__()
        self.activation = activation
        self.act = ACTIVATIONS[activation]()
        self.sizes = sizes
        generator = torch.Generator().manual_seed(seed)
        pairs = list(pairwise(sizes))
        self.weights = nn.ParameterList(
            nn.Parameter(xavier((n_repeats, n_in, n_out), generator)) for n_in, n_out in pairs
        )
        self.biases = nn.ParameterList(
            nn.Parameter(torch.zeros(n_repeats, 1, n_out)) for _, n_out in pairs
        )

    def codes(self, x: torch.Tensor, depth: int) -> torch.Tensor:
        """Return the activations of hidden layer `depth`, shape (n_repeats, n, size)."""
        for k in range(depth):
            x = self.act(affine(x, self.weights[k], self.biases[k]))
        return x

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return what goes into the output function, shape (n_repeats, n, n_out)."""
        return affine(self.codes(x, len(self.sizes) - 2), self.weights[-1], self.biases[-1])


def affine(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """Return x W + b of every repeat; one product where all repeats share `x`."""
    if x.dim() == 2:
        n_repeats, n_in, n_out = weight.shape
        flat = weight.permute(1, 0, 2).reshape(n_in, n_repeats * n_out)
        return (x @ flat).reshape(len(x), n_repeats, n_out).transpose(0, 1) + bias
    return torch.baddbmm(bias.expand(-1, x.shape[1], -1), x, weight)


def probabilities(logits: torch.Tensor) -> torch.Tensor:
    """Return class probabilities, (..., 2), of two outputs or one, that of class 2 (people)."""
    if logits.shape[-1] == 1:
        p = torch.sigmoid(logits)
        return torch.cat([1 - p, p], dim=-1)
    return torch.softmax(logits, dim=-1)


def output_error(logits: torch.Tensor, y: torch.Tensor, kind: str) -> torch.Tensor:
    """Return the mean error of logits, (n_repeats, n, n_outputs), summed over repeats."""
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
