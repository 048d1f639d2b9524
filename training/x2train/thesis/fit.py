"""The thesis' training: autoencoders layer by layer, output layer, the whole network.

Table 4.5: the first autoencoder for 500 epochs on the input, the second for 100 on the codes
of the first, the output layer for 400 on those of the second, then the whole network for up
to 2000, looked at every 100. The version with the best score at any look is kept, repeat by
repeat. The thesis' text keeps the larger cross-entropy, which is worse; we keep the smaller.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from x2train.thesis.checkpoint import (
    Checkpoint,
    fingerprint,
    load_checkpoint,
    save_checkpoint,
)
from x2train.thesis.losses import code_penalty, output_error, scaling_of
from x2train.thesis.mlp import ACTIVATIONS, RepeatedMlp, affine, probabilities, xavier
from x2train.thesis.sets import CellData
from x2train.thesis.settings import FitSettings

_LEAST = 1e-12  # probability: chosen, its logarithm is finite
_LBFGS_MEMORY = 20  # chosen: torch's 100 take five times the memory
_SEED_STRIDE = 1000  # chosen: no repeat has another one's seeds


@dataclass(frozen=True, slots=True)
class Look:
    """The network at one look."""

    stage: str  # 'autoencoder 1', ..., 'output', 'whole'
    # done, and at most to do
    epoch: int
    epochs: int
    # of every repeat: smaller is better; empty before the whole network trains
    scores: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """The result."""

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
    checkpoint: Path | None = None,
    start: Fitted | None = None,
) -> Iterator[Look | Fitted]:
    """Train all repeats; yield every look, and at last the result.

    Parameters
    ----------
    train, stop, settings : CellData, CellData and FitSettings
        What trains, what scores at every look, and how. L-BFGS trains repeat by repeat: its line
        search would tie them together.
    checkpoint : Path, optional
        File that is written at every look and from which a run goes on, with the same result
        as if it had not stopped; one of another run is not taken.
    start : Fitted, optional
        Go on from here, without the autoencoders (retraining on recordings).
    """
    if settings.optimiser != "lbfgs" or settings.repeats == 1 or start is not None:
        yield from _fit(train, stop, settings, checkpoint, start)
        return
    parts: list[Fitted] = []
    for k in range(settings.repeats):
        own = replace(settings, repeats=1, seed=settings.seed + _SEED_STRIDE * k)
        point = None if checkpoint is None else checkpoint.with_suffix(f".{k}.pt")
        for step in _fit(train, stop, own, point, None):
            if isinstance(step, Fitted):
                parts.append(step)
            else:
                yield step
    yield _joined(parts)


def _fit(
    train: CellData,
    stop: CellData,
    settings: FitSettings,
    checkpoint: Path | None,
    start: Fitted | None,
) -> Iterator[Look | Fitted]:
    run = _Run(train, stop, settings, start)
    done = run.load(checkpoint) if checkpoint is not None else 0
    if not done and start is None:
        yield from run.pretrain()
    yield from run.tune(done, checkpoint)
    yield run.result()
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)


def _joined(parts: list[Fitted]) -> Fitted:
    first = parts[0]
    net = RepeatedMlp(len(parts), first.net.sizes, first.net.activation, seed=0)
    states = [part.net.state_dict() for part in parts]
    net.load_state_dict({key: torch.cat([s[key] for s in states]) for key in states[0]})
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
        self, train: CellData, stop: CellData, s: FitSettings, start: Fitted | None
    ) -> None:
        self.s = s
        self.stop = stop
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
        self.mean_net = RepeatedMlp(s.repeats, sizes, s.activation, seed=s.seed).to(device)
        self.best = self._copy()
        self.best_score = np.full(s.repeats, np.inf)
        self.steps = 0
        self.scores: list[list[float]] = []
        self.confidence: list[list[list[float]]] = []
        self.print = fingerprint((train, stop), s, None if start is None else start.net)

    # ------------------------------------------------------------ stages

    def pretrain(self) -> Iterator[Look]:
        """Train the autoencoders, then the output layer on their codes."""
        s, net = self.s, self.net
        act = ACTIVATIONS[s.activation]
        generator = torch.Generator().manual_seed(s.seed + 2)
        for k, epochs in enumerate(s.pretrain_epochs):
            with torch.no_grad():
                inputs = net.codes(self.x, k)
            n_in, n_out = net.sizes[k], net.sizes[k + 1]
            back = nn.Parameter(xavier((s.repeats, n_out, n_in), generator).to(self.x.device))
            bias = nn.Parameter(torch.zeros(s.repeats, 1, n_in, device=self.x.device))
            weights = [net.weights[k], net.biases[k], back, bias]

            def loss(
                part: torch.Tensor,
                inputs: torch.Tensor = inputs,
                k: int = k,
                back: nn.Parameter = back,
                bias: nn.Parameter = bias,
            ) -> torch.Tensor:
                given = inputs[..., part, :]
                codes = act(affine(given, net.weights[k], net.biases[k]))
                # The sum over inputs, not their mean: vectors have unit norm.
                error = (affine(codes, back, bias) - given).square().sum(dim=2).mean(dim=1)
                return error.sum() + s.sparsity * code_penalty(codes, s.activation)

            yield from self._train(f"autoencoder {k + 1}", weights, loss, epochs)
        with torch.no_grad():
            codes = net.codes(self.x, len(s.layers))

        def output_loss(part: torch.Tensor) -> torch.Tensor:
            logits = affine(codes[:, part], net.weights[-1], net.biases[-1])
            return output_error(logits, self.y[part], s.error)

        last = [net.weights[-1], net.biases[-1]]
        yield from self._train("output", last, output_loss, s.output_epochs)

    def tune(self, done: int, checkpoint: Path | None) -> Iterator[Look]:
        """Train the whole network, from look to look."""
        s = self.s
        if not done:
            self.mean_net.load_state_dict(self.net.state_dict())
            yield self._look(0)
        for epoch in range(done + s.look_every, s.epochs + 1, s.look_every):
            if self._idle() >= s.patience:
                return
            self._tune(s.look_every)
            yield self._look(epoch)
            if checkpoint is not None:
                self._save(checkpoint, epoch)

    def result(self) -> Fitted:
        """Return every repeat at its best."""
        self.net.load_state_dict(self.best)
        self.net.cpu()
        scores, confidence = np.array(self.scores), np.array(self.confidence)
        return Fitted(self.net, self.mean, self.scale, scores, confidence)

    # ------------------------------------------------------------ steps

    def _tune(self, epochs: int) -> None:
        def loss(part: torch.Tensor) -> torch.Tensor:
            return output_error(self.net(self.x[part]), self.y[part], self.s.error)

        weights = list(self.net.parameters())
        if self.s.optimiser == "lbfgs":
            self._line_search(weights, loss, epochs)
            self.mean_net.load_state_dict(self.net.state_dict())
            return
        for _ in self._train("whole", weights, loss, epochs, mean=True):
            pass

    def _line_search(
        self,
        weights: list[nn.Parameter],
        loss: Callable[[torch.Tensor], torch.Tensor],
        epochs: int,
    ) -> None:
        optimiser = torch.optim.LBFGS(
            weights, max_iter=epochs, history_size=_LBFGS_MEMORY, line_search_fn="strong_wolfe"
        )
        everything = torch.arange(len(self.x))

        def closure() -> torch.Tensor:
            optimiser.zero_grad()
            penalty = torch.stack([w.square().sum() for w in self.net.weights]).sum()
            value = loss(everything) + self.s.decay / 2 * penalty
            value.backward()  # type: ignore[no-untyped-call]
            return value

        optimiser.step(closure)  # type: ignore[no-untyped-call]

    def _train(
        self,
        stage: str,
        weights: list[nn.Parameter],
        loss: Callable[[torch.Tensor], torch.Tensor],
        epochs: int,
        *,
        mean: bool = False,
    ) -> Iterator[Look]:
        s = self.s
        # A new optimiser at every look: a run that goes on is then the run that never stopped.
        optimiser: torch.optim.Optimizer = (
            torch.optim.SGD(weights, s.learning_rate, momentum=s.momentum, weight_decay=s.decay)
            if s.optimiser == "momentum"
            else torch.optim.AdamW(
                weights,
                s.learning_rate,
                betas=(s.momentum, 0.999),
                weight_decay=s.decay,
                fused=True,
            )
        )
        for epoch in range(1, epochs + 1):
            for part in torch.split(torch.randperm(len(self.x), generator=self.order), s.batch):
                optimiser.zero_grad()
                loss(part).backward()  # type: ignore[no-untyped-call]
                optimiser.step()
                if mean:
                    self._average()
            if epoch % s.look_every == 0:
                yield Look(stage, epoch, epochs)

    def _average(self) -> None:
        self.steps += 1
        # At first the mean forgets faster, or it would hold on to the initial weights.
        kept = min(self.s.averaging, self.steps / (self.steps + 10)) if self.s.averaging else 0.0
        means, weights = list(self.mean_net.parameters()), list(self.net.parameters())
        with torch.no_grad():
            for mean, now in zip(means, weights, strict=True):
                mean.lerp_(now, 1 - kept)

    # ------------------------------------------------------------ looks

    def _look(self, epoch: int) -> Look:
        with torch.no_grad():
            inputs = torch.from_numpy((self.stop.x - self.mean) * self.scale).to(self.x.device)
            p = probabilities(self.mean_net(inputs).double()).cpu().numpy()
        y = self.stop.y
        truth = np.take_along_axis(p, y[None, :, None], axis=2)[..., 0]
        scores = -np.log(np.maximum(truth, _LEAST)).mean(axis=1)
        self.scores.append(scores.tolist())
        self.confidence.append(
            np.stack([truth[:, y == c].mean(axis=1) for c in (0, 1)], axis=1).tolist()
        )
        if epoch:
            gained = scores < self.best_score
            self.best_score = np.where(gained, scores, self.best_score)
            which = torch.from_numpy(np.flatnonzero(gained))
            for name, value in self._copy().items():
                self.best[name][which] = value[which]
        return Look("whole", epoch, self.s.epochs, tuple(self.scores[-1]))

    def _idle(self) -> int:
        """Return how many looks have passed since any repeat was at its best."""
        trained = np.array(self.scores[1:])
        return 0 if not len(trained) else len(trained) - 1 - int(trained.argmin(axis=0).max())

    def _copy(self) -> dict[str, torch.Tensor]:
        return {k: v.detach().clone() for k, v in self.mean_net.state_dict().items()}

    # ------------------------------------------------------------ checkpoints

    def _save(self, path: Path, epoch: int) -> None:
        point = Checkpoint(
            self.print,
            epoch,
            self.steps,
            self.net.state_dict(),
            self.mean_net.state_dict(),
            self.best,
            self.best_score.tolist(),
            self.scores,
            self.confidence,
            self.order.get_state(),
        )
        save_checkpoint(path, point)

    def load(self, path: Path) -> int:
        """Go on from a checkpoint of the same run; return the epoch, 0 for none."""
        point = load_checkpoint(path)
        if point is None or point.print != self.print:
            return 0
        self.net.load_state_dict(point.net)
        self.mean_net.load_state_dict(point.mean_net)
        self.best = {k: v.to(self.x.device) for k, v in point.best.items()}
        self.best_score = np.array(point.best_score)
        self.scores, self.confidence = point.scores, point.confidence
        self.order.set_state(point.order)
        self.steps = point.steps
        return point.epoch
