"""Training: cross-entropy, Adam, the best epoch on a validation part, temperature after."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from x2train.nets.epoch import Epoch, temperature_of
from x2train.nets.nets import ThesisNet
from x2train.studies.baseline.dataset import LabelledSet


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainSettings:
    """How to train.

    Attributes
    ----------
    epochs : int
        Passes over the training part.
    batch : int
        Elements a step.
    learning_rate : float
        Of Adam.
    weight_decay : float
        L2 penalty.
    noise : float
        Standard deviation of Gaussian noise put on the (unit norm) features.
    seed : int
        Of the initial weights and the order.
    """

    epochs: int = 60
    batch: int = 128
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    noise: float = 0.0
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Trained:
    """A network at its best epoch, and the temperature that calibrates it."""

    net: ThesisNet
    temperature: float
    best_epoch: int


def fit(
    train: LabelledSet, validation: LabelledSet, settings: TrainSettings
) -> Iterator[Epoch | Trained]:
    """Train; yield every epoch, and at last the network.

    One thread and fixed seeds: the same input gives the same weights on one machine.

    Parameters
    ----------
    train, validation : LabelledSet
        Disjoint draws.
    settings : TrainSettings
        How.

    Yields
    ------
    Epoch or Trained
        Progress, then the result.
    """
    torch.manual_seed(settings.seed)
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    net = ThesisNet(train.x.shape[1])
    optimiser = torch.optim.Adam(
        net.parameters(), settings.learning_rate, weight_decay=settings.weight_decay
    )
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, settings.epochs)
    error = nn.CrossEntropyLoss()
    x, y = torch.from_numpy(train.x), torch.from_numpy(train.y)
    xv, yv = torch.from_numpy(validation.x), torch.from_numpy(validation.y)
    best = (float("inf"), 0, {k: v.clone() for k, v in net.state_dict().items()})
    for number in range(1, settings.epochs + 1):
        net.train()
        total = 0.0
        for part in torch.split(torch.randperm(len(x)), settings.batch):
            inputs = x[part]
            if settings.noise:
                inputs = inputs + settings.noise * torch.randn_like(inputs)
            loss = error(net(inputs), y[part])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            total += loss.item() * len(part)
        schedule.step()
        net.eval()
        with torch.no_grad():
            score = float(error(net(xv), yv))
        if score < best[0]:
            best = (score, number, {k: v.clone() for k, v in net.state_dict().items()})
        yield Epoch(number, total / len(x), score)
    net.load_state_dict(best[2])
    net.eval()
    with torch.no_grad():
        logits = net(xv).numpy().astype(np.float64)
    yield Trained(net, temperature_of(logits, validation.y), best[1])
