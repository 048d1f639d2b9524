"""Temporal head: it integrates evidence over successive windows, learned instead of summed.

It takes what the network's last layer is given, so nothing of a window is lost on the way
through three probabilities::

    projected = relu(A (given - mean) / spread + a)
    hidden    = gru(projected, hidden)           (Cho et al. 2014, recalled; torch's variant)
    logits    = B hidden + b

Hidden values begin at zero whenever the gate has opened. What counts is the verdict of a visit, so
the windows after 3, 5 and 8 s weigh more than the others.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from x2train.nets.epoch import Epoch, temperature_of

_IGNORED = -100  # torch's label for what does not count
_VERDICTS = (2, 4, 7)
"""Windows after the first at which a visit may be judged: 3, 5 and 8 s (`decide_within_s`)."""
_BESIDE = 0.3  # what other windows count against those


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """Windows as a head sees them, in order within what the daemon would see in one go."""

    values: NDArray[np.float32]  # (n, n_given): what the network's last layer is given
    label: NDArray[np.int64]
    is_first: NDArray[np.bool_]  # (n,): where the gate has opened

    def runs(self) -> list[slice]:
        """Return the windows of every stay."""
        first = np.flatnonzero(self.is_first)
        ends = np.append(first[1:], len(self.is_first))
        return [slice(int(a), int(b)) for a, b in zip(first, ends, strict=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadSettings:
    """How large a head is, and how it is trained."""

    n_projected: int = 16
    n_hidden: int = 24
    epochs: int = 6  # passes over the stays
    batch: int = 64  # stays a step
    learning_rate: float = 5e-3  # greatest of the one cycle
    weight_decay: float = 1e-3
    dropout: float = 0.3  # of what is given, in training
    seed: int = 0  # of weights and order


class TemporalHead(nn.Module):
    """Recurrent network (GRU) over the windows of a passage, on the last layer's input."""

    mean: torch.Tensor
    spread: torch.Tensor

    def __init__(
        self,
        mean: NDArray[np.float32],
        spread: NDArray[np.float32],
        settings: HeadSettings,
    ) -> None:
        super().__init__()
        self.register_buffer("mean", torch.from_numpy(mean))
        self.register_buffer("spread", torch.from_numpy(spread))
        self.dropout = nn.Dropout(settings.dropout)
        self.projection = nn.Linear(len(mean), settings.n_projected)
        self.gru = nn.GRU(settings.n_projected, settings.n_hidden, batch_first=True)
        self.out = nn.Linear(settings.n_hidden, 3)

    def forward(self, given: torch.Tensor) -> torch.Tensor:
        """Return logits, shape (n, n_windows, 3), of stays, (n, n_windows, n_given)."""
        z = self.dropout((given - self.mean) / self.spread)
        hidden, _ = self.gru(torch.relu(self.projection(z)))
        logits: torch.Tensor = self.out(hidden)
        return logits


@dataclass(frozen=True, slots=True, eq=False)
class HeadTrained:
    """A head, and the temperature that calibrates it."""

    head: TemporalHead
    temperature: float


def fit_head(
    train: Given, validation: Given, settings: HeadSettings
) -> Iterator[Epoch | HeadTrained]:
    """Train on passages apart from those to validate on; yield every epoch, and at last the head.

    Classes weigh the same, however many windows each has. Same seed, same weights on one machine.
    """
    torch.manual_seed(settings.seed)
    torch.set_num_threads(1)
    rng = torch.Generator().manual_seed(settings.seed)
    spread = np.maximum(train.values.std(axis=0), 1e-3)
    head = TemporalHead(train.values.mean(axis=0), spread, settings)
    counts = np.bincount(train.label, minlength=3)
    weight = torch.from_numpy((counts.sum() / (3 * np.maximum(counts, 1))).astype(np.float32))
    runs = train.runs()
    optimiser = torch.optim.AdamW(head.parameters(), weight_decay=settings.weight_decay)
    n_steps = settings.epochs * -(-len(runs) // settings.batch)
    cycle = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, settings.learning_rate, total_steps=n_steps
    )
    for number in range(1, settings.epochs + 1):
        head.train()
        total, n = 0.0, 0
        for part in torch.split(torch.randperm(len(runs), generator=rng), settings.batch):
            values, label = _padded(train, [runs[k] for k in part.tolist()])
            each = functional.cross_entropy(
                head(values).flatten(0, 1),
                label.flatten(),
                weight,
                ignore_index=_IGNORED,
                reduction="none",
            )
            share = _shares(label)
            loss = (each * share).sum() / share.sum()
            optimiser.zero_grad()
            torch.autograd.backward(loss)
            nn.utils.clip_grad_norm_(head.parameters(), 1.0)
            optimiser.step()
            cycle.step()
            total, n = total + loss.item() * len(part), n + len(part)
        yield Epoch(number, total / n, _loss(logits_over(head, validation), validation.label))
    logits = logits_over(head, validation)
    yield HeadTrained(head, temperature_of(logits, validation.label))


def logits_over(head: TemporalHead, given: Given) -> NDArray[np.float64]:
    """Return the logits after every window, shape (n, 3)."""
    head.eval()
    out = np.empty((len(given.label), 3))
    with torch.no_grad():
        for run in given.runs():
            out[run] = head(torch.from_numpy(given.values[run])[None])[0].numpy()
    return out


def _padded(given: Given, runs: list[slice]) -> tuple[torch.Tensor, torch.Tensor]:
    longest = max(run.stop - run.start for run in runs)
    values = torch.zeros(len(runs), longest, given.values.shape[1])
    label = torch.full((len(runs), longest), _IGNORED)
    for k, run in enumerate(runs):
        n = run.stop - run.start
        values[k, :n] = torch.from_numpy(given.values[run])
        label[k, :n] = torch.from_numpy(given.label[run])
    return values, label


def _shares(label: torch.Tensor) -> torch.Tensor:
    """Return what each window counts, shape (n * n_windows,): most where visits are judged."""
    share = torch.full(label.shape, _BESIDE)
    share[:, [k for k in _VERDICTS if k < label.shape[1]]] = 1.0
    share[label == _IGNORED] = 0.0
    return share.flatten()


def _loss(logits: NDArray[np.float64], label: NDArray[np.int64]) -> float:
    return float(functional.cross_entropy(torch.from_numpy(logits), torch.from_numpy(label)))
