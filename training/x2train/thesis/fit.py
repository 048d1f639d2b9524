"""The thesis' network Q-100-50-2 and its training, for many initial weights at once.

All repeats share one tensor a layer, so that a step costs one product for all of them; they meet
nowhere else: the loss is a sum over repeats, and optimisers work element by element. Autoencoders
train layer by layer, then the output layer, then the whole network (table 4.5).

The version with the best score at any look is kept, repeat by repeat. The thesis' text keeps the
larger cross-entropy, which is worse; we keep the smaller.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from radard.errors import UsageError
from x2train.thesis.sets import CellData

_TYPE1 = 784  # 28 x 28: M times I alpha
_LBFGS_MEMORY = 20  # torch's 100 take five times the memory
Tell = Callable[[str, int, int], None]  # what is done, how far, of how much
_MIN_P = 1e-12  # its logarithm is finite
_SPARSE_TO = 0.05  # as usual for sparse autoencoders
ACTIVATIONS: dict[str, type[nn.Module]] = {"relu": nn.ReLU, "sigmoid": nn.Sigmoid, "tanh": nn.Tanh}
_SEED_STRIDE = 1000  # no repeat has another one's seeds


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """Layers, optimiser and schedule of a training of the thesis' network."""

    layers: tuple[int, ...] = (100, 50)
    activation: str = "relu"  # 'relu', 'sigmoid' or 'tanh'
    n_outputs: int = 2  # 2 (softmax), or 1 (logistic)
    error: str = "cross-entropy"  # 'cross-entropy', 'mse': what training makes small
    # 'adam', 'momentum', 'lbfgs': batches of `batch`, but for L-BFGS, which takes the whole set
    optimiser: str = "adam"
    learning_rate: float = 0.001  # of the optimiser; L-BFGS searches along its line and takes none
    # share of the last step in the next one (3.5); with Adam, of its mean gradient
    momentum: float = 0.9
    batch: int = 100
    # a step takes this times the learning rate off every weight: an L2 penalty, with Adam in its
    # decoupled form (Loshchilov and Hutter 2019, recalled). L-BFGS gets the penalty itself. It
    # holds in every stage: autoencoders without it learn to blow up the weakest inputs.
    decay: float = 0.7
    # networks are judged by the running mean of their weights, this share of it kept at every
    # step (Polyak and Juditsky 1992, recalled); 0 for the weights themselves
    averaging: float = 0.999
    # penalty on the autoencoders' codes: L1 for ReLU, else the Kullback-Leibler divergence of
    # their mean from 0.05
    sparsity: float = 0.0
    pretrain_epochs: tuple[int, ...] = (500, 100)  # of each autoencoder; () for none
    output_epochs: int = 400  # of the output layer alone
    # of the whole network, and how often it is looked at
    epochs: int = 2000
    look_every: int = 100
    patience: int = 2  # looks without a gain in any repeat that end a training
    repeats: int = 10  # initial weights tried
    seed: int = 0  # of weights and order
    # 'none', 'block', 'each': inputs as they are; the range profile and the type 1 part each by
    # one factor to a mean square of 1; or every input to mean 0 and deviation 1
    scaling: str = "none"

    def __post_init__(self) -> None:
        """Validate the settings; the error names every wrong one."""
        n_pretrain = len(self.pretrain_epochs)
        rules = (
            ("layers", bool(self.layers) and min(self.layers) > 0, "at least one, above 0"),
            ("learning_rate", 0 < self.learning_rate <= 10, "above 0, at most 10"),
            ("momentum", 0 <= self.momentum < 1, "0 to below 1"),
            ("batch", self.batch > 0, "1 or more"),
            ("decay", self.decay >= 0, "0 or more"),
            ("averaging", 0 <= self.averaging < 1, "0 to below 1"),
            ("sparsity", self.sparsity >= 0, "0 or more"),
            ("pretrain_epochs", min(self.pretrain_epochs, default=0) >= 0, "none below 0"),
            ("pretrain_epochs", n_pretrain in {0, len(self.layers)}, "none, or one a layer"),
            ("output_epochs", self.output_epochs >= 0, "0 or more"),
            ("epochs", self.epochs >= self.look_every > 0, "at least look_every, above 0"),
            ("patience", self.patience > 0, "1 or more"),
            ("repeats", self.repeats > 0, "1 or more"),
            ("seed", self.seed >= 0, "0 or more"),
        )
        faults = [
            f"{name} = {getattr(self, name)!r}: {rule}" for name, good, rule in rules if not good
        ]
        if faults:
            raise UsageError("; ".join(faults))


def fit_settings(activation: str, **changes: Any) -> FitSettings:
    """Return the settings that suit an activation, with changes; raises as `FitSettings`."""
    if activation != "relu":
        # Inputs of unit norm would leave every unit in the middle of its curve.
        changes = {"scaling": "block", "decay": 0.1, **changes}
    return FitSettings(activation=activation, **changes)


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


def of_truth(
    p: NDArray[np.float64], y: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return probabilities of the true classes, (n_repeats, n), and repeats' cross-entropy."""
    truth = np.take_along_axis(p, y[None, :, None], axis=2)[..., 0]
    return truth, -np.log(np.maximum(truth, _MIN_P)).mean(axis=1)


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


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """Trained networks of all repeats, and how they came there."""

    net: RepeatedMlp  # every repeat at its best look
    # (Q,): the input is taken as (x - mean) scale
    mean: NDArray[np.float32]
    scale: NDArray[np.float32]
    # (n_looks, n_repeats): cross-entropy on the elements that stop training, look by look, the
    # first before the whole network trained
    scores: NDArray[np.float64]
    # (n_looks, n_repeats, 2): mean probability of the true class, by class, likewise
    confidence: NDArray[np.float64]

    def predict(self, x: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return probabilities, shape (n_repeats, n, 2), float64."""
        with torch.no_grad():
            inputs = torch.from_numpy((x - self.mean) * self.scale)
            return probabilities(self.net(inputs).double()).numpy()

    @property
    def best_looks(self) -> NDArray[np.int64]:
        """Return the look that was kept of each repeat; the first cannot be."""
        return np.asarray(self.scores[1:].argmin(axis=0) + 1, np.int64)

    @property
    def best_repeat(self) -> int:
        """Return the repeat with the best score at any look but the first."""
        return int(self.scores[1:].min(axis=0).argmin())


def fit(
    train: CellData,
    stop: CellData,
    settings: FitSettings,
    *,
    start: Fitted | None = None,
    tell: Tell = lambda *_: None,
) -> Fitted:
    """Train all repeats on `train`, scored on `stop` at every look, which `tell` is told of.

    L-BFGS trains repeat by repeat: its line search would tie them together. With `start` a
    training goes on from there, without the autoencoders (retraining on recordings).
    """
    each = [settings]
    if settings.optimiser == "lbfgs" and start is None:
        seeds = (settings.seed + _SEED_STRIDE * k for k in range(settings.repeats))
        each = [replace(settings, repeats=1, seed=seed) for seed in seeds]
    return _joined([_Run(train, stop, own, start, tell).fitted() for own in each])


def scaling_of(
    x: NDArray[np.float32], how: str
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return what is taken from every input, and the factor on it; see `FitSettings`."""
    mean, scale = np.zeros(x.shape[1]), np.ones(x.shape[1])
    if how == "each":
        mean = x.mean(axis=0, dtype=np.float64)
        sd = x.std(axis=0, dtype=np.float64)
        floor = 0.1 * np.median(sd[sd > 0]) if (sd > 0).any() else 1.0
        scale = np.where(sd > 0, 1 / np.maximum(sd, floor), 0.0)
    elif how == "block":
        for part in (slice(0, -_TYPE1), slice(-_TYPE1, None)):
            power = np.mean(np.square(x[:, part], dtype=np.float64)) if x[:, part].size else 0.0
            scale[part] = power**-0.5 if power > 0 else 1.0
    return mean.astype(np.float32), scale.astype(np.float32)


def _joined(parts: list[Fitted]) -> Fitted:
    first, states = parts[0], [part.net.state_dict() for part in parts]
    joined = {key: torch.cat([s[key] for s in states]) for key in states[0]}
    net = RepeatedMlp(len(joined["weights.0"]), first.net.sizes, first.net.activation, seed=0)
    net.load_state_dict(joined)
    n_looks = max(len(part.scores) for part in parts)

    def padded(values: NDArray[np.float64]) -> NDArray[np.float64]:
        last = np.repeat(values[-1:], n_looks - len(values), axis=0)
        return np.concatenate([values, last])

    return Fitted(
        net,
        first.mean,
        first.scale,
        np.concatenate([padded(part.scores) for part in parts], axis=1),
        np.concatenate([padded(part.confidence) for part in parts], axis=1),
    )


class _Run:
    def __init__(
        self, train: CellData, stop: CellData, s: FitSettings, start: Fitted | None, tell: Tell
    ) -> None:
        self.s, self.stop, self.start, self.tell = s, stop, start, tell
        self.mean, self.scale = (
            scaling_of(train.x, s.scaling) if start is None else (start.mean, start.scale)
        )
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self.x = torch.from_numpy((train.x - self.mean) * self.scale).to(device)
        self.y = torch.from_numpy(train.y).to(device)
        sizes = (train.x.shape[1], *s.layers, s.n_outputs)
        self.net = RepeatedMlp(s.repeats, sizes, s.activation, seed=s.seed)
        if start is not None:
            self.net.load_state_dict(start.net.state_dict())
        self.net.to(device)
        self.order = torch.Generator().manual_seed(s.seed + 1)
        self.mean_net = deepcopy(self.net)
        self.best = deepcopy(self.mean_net.state_dict())
        self.steps = 0
        self.scores: list[NDArray[np.float64]] = []
        self.confidence: list[NDArray[np.float64]] = []

    def fitted(self) -> Fitted:
        """Train; return every repeat at its best."""
        if self.start is None:
            self._pretrain()
        self._tune()
        self.net.load_state_dict(self.best)
        self.net.cpu()
        scores, confidence = np.array(self.scores), np.array(self.confidence)
        return Fitted(self.net, self.mean, self.scale, scores, confidence)

    def _pretrain(self) -> None:
        """Train the autoencoders, then the output layer on their codes."""
        s, net = self.s, self.net
        generator = torch.Generator().manual_seed(s.seed + 2)
        for k, epochs in enumerate(s.pretrain_epochs):
            self._autoencode(k, epochs, generator)
        with torch.no_grad():
            codes = net.codes(self.x, len(s.layers))

        def output_loss(part: torch.Tensor) -> torch.Tensor:
            logits = affine(codes[:, part], net.weights[-1], net.biases[-1])
            return output_error(logits, self.y[part], s.error)

        last = [net.weights[-1], net.biases[-1]]
        self._train("output", last, output_loss, s.output_epochs)

    def _autoencode(self, k: int, epochs: int, generator: torch.Generator) -> None:
        s, net = self.s, self.net
        with torch.no_grad():
            inputs = net.codes(self.x, k)
        n_in, n_out = net.sizes[k], net.sizes[k + 1]
        back = nn.Parameter(xavier((s.repeats, n_out, n_in), generator).to(self.x.device))
        bias = nn.Parameter(torch.zeros(s.repeats, 1, n_in, device=self.x.device))
        coder = (net.weights[k], net.biases[k])

        def loss(part: torch.Tensor) -> torch.Tensor:
            given = inputs[..., part, :]
            codes = net.act(affine(given, *coder))
            # The sum over inputs, not their mean: vectors have unit norm.
            error = (affine(codes, back, bias) - given).square().sum(dim=2).mean(dim=1)
            return error.sum() + s.sparsity * code_penalty(codes, s.activation)

        self._train(f"autoencoder {k + 1}", [*coder, back, bias], loss, epochs)

    def _tune(self) -> None:
        """Train the whole network, from look to look."""
        s = self.s
        self.mean_net.load_state_dict(self.net.state_dict())
        self._look(0)
        for epoch in range(s.look_every, s.epochs + 1, s.look_every):
            if self._idle() >= s.patience:
                return
            if s.optimiser == "lbfgs":
                self._line_search()
            else:
                self._train("", list(self.net.parameters()), self._loss, s.look_every)
            self._look(epoch)

    def _loss(self, part: torch.Tensor) -> torch.Tensor:
        return output_error(self.net(self.x[part]), self.y[part], self.s.error)

    def _line_search(self) -> None:
        optimiser = torch.optim.LBFGS(
            self.net.parameters(),
            max_iter=self.s.look_every,
            history_size=_LBFGS_MEMORY,
            line_search_fn="strong_wolfe",
        )
        everything = torch.arange(len(self.x))

        def closure() -> torch.Tensor:
            optimiser.zero_grad()
            penalty = torch.stack([w.square().sum() for w in self.net.weights]).sum()
            value = self._loss(everything) + self.s.decay / 2 * penalty
            value.backward()  # type: ignore[no-untyped-call]
            return value

        optimiser.step(closure)  # type: ignore[no-untyped-call]
        self.mean_net.load_state_dict(self.net.state_dict())

    def _train(
        self,
        stage: str,
        weights: list[nn.Parameter],
        loss: Callable[[torch.Tensor], torch.Tensor],
        epochs: int,
    ) -> None:
        """Train a stage, and tell of it; or, without a name, the whole network up to a look."""
        s = self.s
        # A new one at every look, so that momentum does not carry over what was averaged.
        given: dict[str, Any] = {"lr": s.learning_rate, "weight_decay": s.decay}
        optimiser: torch.optim.Optimizer
        if s.optimiser == "momentum":
            optimiser = torch.optim.SGD(weights, momentum=s.momentum, **given)
        else:
            optimiser = torch.optim.AdamW(weights, betas=(s.momentum, 0.999), fused=True, **given)
        for epoch in range(1, epochs + 1):
            for part in torch.split(torch.randperm(len(self.x), generator=self.order), s.batch):
                optimiser.zero_grad()
                loss(part).backward()  # type: ignore[no-untyped-call]
                optimiser.step()
                if not stage:
                    self._average()
            if stage and epoch % s.look_every == 0:
                self.tell(stage, epoch, epochs)

    def _average(self) -> None:
        self.steps += 1
        # At first the mean forgets faster, or it would hold on to the initial weights.
        kept = min(self.s.averaging, self.steps / (self.steps + 10)) if self.s.averaging else 0.0
        means, weights = list(self.mean_net.parameters()), list(self.net.parameters())
        with torch.no_grad():
            for mean, now in zip(means, weights, strict=True):
                mean.lerp_(now, 1 - kept)

    def _look(self, epoch: int) -> None:
        with torch.no_grad():
            inputs = torch.from_numpy((self.stop.x - self.mean) * self.scale).to(self.x.device)
            p = probabilities(self.mean_net(inputs).double()).cpu().numpy()
        y = self.stop.y
        truth, scores = of_truth(p, y)
        self.confidence.append(np.stack([truth[:, y == c].mean(axis=1) for c in (0, 1)], axis=1))
        if epoch:
            gained = scores < np.min(self.scores[1:], axis=0, initial=np.inf)
            which = torch.from_numpy(np.flatnonzero(gained))
            for name, value in self.mean_net.state_dict().items():
                self.best[name][which] = value[which]
        self.scores.append(scores)
        self.tell(f"whole, best score {scores.min():.3f}", epoch, self.s.epochs)

    def _idle(self) -> int:
        """Return how many looks have passed since any repeat was at its best."""
        trained = np.array(self.scores[1:])
        return 0 if not len(trained) else len(trained) - 1 - int(trained.argmin(axis=0).max())
