"""Temporal head: it integrates evidence over successive windows, learned instead of summed.

The mean of its parts' logits counts, each a GRU (Cho et al. 2014, recalled) over a projection:
`given` of what the network's last layer is given, `said` of the probabilities alone, which holds
for bodies that nobody trained on, and of a mean of networks one for each that is heard `apart`
(docs/research/evaluation-tried.md). Hidden values begin at zero whenever the gate has opened; the
windows after 3, 5 and 8 s weigh more.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional
from torch.nn.utils.rnn import pad_sequence

from x2train.nets.calibration import Epoch, Trained, cross_entropy, temperature_of

N_CLASSES = 3
_IGNORED = -100  # torch's label for what does not count
_VERDICTS = (2, 4, 7)  # windows at which a visit may be judged: 3, 5 and 8 s
_BESIDE = 0.3  # what other windows count against those


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """Windows as a head sees them, in order within what the daemon would see in one go."""

    values: NDArray[np.float32]  # (n, n_given): what the network's last layer is given
    log_p: NDArray[np.float32]  # (n, 3): what it says of each window alone, calibrated
    label: NDArray[np.int64]
    is_first: NDArray[np.bool_]  # (n,): where the gate has opened

    def runs(self) -> list[slice]:
        """Return the windows of every stay."""
        first = np.flatnonzero(self.is_first)
        ends = np.append(first[1:], len(self.is_first))
        return [slice(int(a), int(b)) for a, b in zip(first, ends, strict=True)]


@dataclass(frozen=True, slots=True)
class HeadSettings:
    """How large a head is, and how it is trained."""

    n_projected: int = 16
    n_hidden: int = 24
    n_said: int = 0  # both, of the part that takes what was said; 0: there is none
    epochs: int = 6  # passes over the stays
    batch: int = 64  # stays a step
    learning_rate: float = 5e-3  # greatest of the one cycle
    weight_decay: float = 1e-3
    dropout: float = 0.3  # of what is given, in training
    seed: int = 0  # of weights and order
    started_rate: float = 0.3  # of the learning rate, from another head: it is not to forget
    # Of a mean: which values of what is given are a network's that is heard apart, first and end.
    apart: tuple[tuple[int, int], ...] = ()
    apart_share: float = 0.4  # of the mean, of all of these together

    @property
    def shares(self) -> dict[str, float]:
        """What every part counts, by its name among the weights; the sum is one."""
        own = ["given", *(["said"] if self.n_said else [])]
        rest = 1.0 - self.apart_share if self.apart else 1.0
        apart = [f"apart.{k}" for k in range(len(self.apart))]
        each = self.apart_share / max(1, len(apart))
        return {**dict.fromkeys(own, rest / len(own)), **dict.fromkeys(apart, each)}


class TemporalHead(nn.Module):
    """Recurrent networks (GRU) over a passage: of what is given, and of what is said."""

    mean: torch.Tensor
    spread: torch.Tensor

    def __init__(
        self, mean: NDArray[np.float32], spread: NDArray[np.float32], settings: HeadSettings
    ) -> None:
        super().__init__()
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("spread", torch.from_numpy(spread))
        self.dropout = nn.Dropout(settings.dropout)
        self.given = _part(len(mean), settings.n_projected, settings.n_hidden)
        n_said = settings.n_said
        self.said = _part(N_CLASSES, n_said, n_said) if n_said else None
        self.apart = nn.ModuleList(
            _part(end - first, settings.n_projected, settings.n_hidden)
            for first, end in settings.apart
        )
        self.settings = settings

    @property
    def n_hidden(self) -> int:
        """Number of values that go from one window to the next."""
        return self.settings.n_hidden * (1 + len(self.apart)) + self.settings.n_said

    def forward(self, given: torch.Tensor, log_p: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return each part's logits, shape (n, n_windows, 3), of stays, (n, n_windows, ...)."""
        z = self.dropout((given - self.mean) / self.spread)
        made = [_judged(self.given, torch.relu, z)]
        if self.said is not None:
            made.append(_judged(self.said, torch.tanh, log_p))
        for part, (first, end) in zip(self.apart, self.settings.apart, strict=True):
            made.append(_judged(part, torch.relu, z[..., first:end]))
        return tuple(made)


def _judged(part: Any, bend: Callable[..., torch.Tensor], x: torch.Tensor) -> torch.Tensor:
    hidden, _ = part["gru"](bend(part["projection"](x)))
    logits: torch.Tensor = part["out"](hidden)
    return logits


def _part(n_in: int, n_projected: int, n_hidden: int) -> nn.ModuleDict:
    return nn.ModuleDict(
        {
            "projection": nn.Linear(n_in, n_projected),
            "gru": nn.GRU(n_projected, n_hidden, batch_first=True),
            "out": nn.Linear(n_hidden, N_CLASSES),
        }
    )


def fit_head(
    train: Given,
    validation: Given,
    settings: HeadSettings,
    start: Mapping[str, NDArray[np.float64]] | None = None,
) -> Iterator[Epoch | Trained[TemporalHead]]:
    """Train on passages apart from those to validate on; yield every epoch, at last the head.

    `start` are weights of a head to go on from, those of its projection without mean and spread
    (`export.head_of`). Where networks are heard apart as well, these parts alone learn.
    """
    torch.manual_seed(settings.seed)
    torch.set_num_threads(1)
    rng = torch.Generator().manual_seed(settings.seed)
    spread = np.maximum(train.values.std(axis=0), 1e-3)
    head = TemporalHead(train.values.mean(axis=0), spread, settings)
    rate = settings.learning_rate
    if start is not None:
        _go_on(head, start)
        if settings.apart:
            head.requires_grad_(requires_grad=False)
            head.apart.requires_grad_(requires_grad=True)
        else:
            rate *= settings.started_rate
    counts = np.bincount(train.label, minlength=3)
    weight = torch.from_numpy((counts.sum() / (3 * np.maximum(counts, 1))).astype(np.float32))
    runs = train.runs()
    learns = [each for each in head.parameters() if each.requires_grad]
    optimiser = torch.optim.AdamW(learns, weight_decay=settings.weight_decay)
    n_steps = settings.epochs * -(-len(runs) // settings.batch)
    cycle = torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=n_steps)
    for number in range(1, settings.epochs + 1):
        head.train()
        total, n = 0.0, 0
        for part in torch.split(torch.randperm(len(runs), generator=rng), settings.batch):
            values, log_p, label = _padded(train, [runs[k] for k in part.tolist()])
            share = _shares(label)
            # Each part learns to judge alone.
            loss = torch.stack(
                [_mean_loss(each, label, weight, share) for each in head(values, log_p)]
            ).mean()
            optimiser.zero_grad()
            torch.autograd.backward(loss)
            nn.utils.clip_grad_norm_(learns, 1.0)
            optimiser.step()
            cycle.step()
            total, n = total + loss.item() * len(part), n + len(part)
        score = cross_entropy(logits_over(head, validation), validation.label)
        yield Epoch(number, total / n, score)
    logits = logits_over(head, validation)
    yield Trained(head, temperature_of(logits, validation.label))


def _go_on(head: TemporalHead, start: Mapping[str, NDArray[np.float64]]) -> None:
    """Give a head another one's weights; what that was not given counts nothing at first."""
    mean, spread = head.mean.double().numpy(), head.spread.double().numpy()
    weight = start["given.projection.weight"]
    wider = np.zeros((len(weight), len(mean)))
    wider[:, -weight.shape[1] :] = weight
    state = {
        **{key: value.double().numpy() for key, value in head.state_dict().items()},
        **start,
        "given.projection.weight": wider * spread,
        "given.projection.bias": start["given.projection.bias"] + wider @ mean,
        "mean": mean,
        "spread": spread,
    }
    head.load_state_dict({key: torch.from_numpy(value).float() for key, value in state.items()})


def logits_over(head: TemporalHead, given: Given) -> NDArray[np.float64]:
    """Return the logits after every window, shape (n, 3)."""
    head.eval()
    out = np.empty((len(given.label), N_CLASSES))
    shares = list(head.settings.shares.values())
    with torch.no_grad():
        for run in given.runs():
            windows = [torch.from_numpy(each[run])[None] for each in (given.values, given.log_p)]
            made = [part[0].double().numpy() for part in head(*windows)]
            out[run] = np.tensordot(shares, made, 1)
    return out


def _padded(given: Given, runs: list[slice]) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    def stays(values: NDArray[Any], missing: float = 0.0) -> torch.Tensor:
        parts = [torch.from_numpy(values[run]) for run in runs]
        return pad_sequence(parts, batch_first=True, padding_value=missing)

    return stays(given.values), stays(given.log_p), stays(given.label, _IGNORED)


def _mean_loss(
    logits: torch.Tensor, label: torch.Tensor, weight: torch.Tensor, share: torch.Tensor
) -> torch.Tensor:
    each = functional.cross_entropy(
        logits.flatten(0, 1), label.flatten(), weight, ignore_index=_IGNORED, reduction="none"
    )
    return (each * share).sum() / share.sum()


def _shares(label: torch.Tensor) -> torch.Tensor:
    """Return what each window counts, shape (n * n_windows,): most where visits are judged."""
    share = torch.full(label.shape, _BESIDE)
    share[:, [k for k in _VERDICTS if k < label.shape[1]]] = 1.0
    share[label == _IGNORED] = 0.0
    return share.flatten()
