"""A small convolutional network on the micro-Doppler spectrogram, as a picture.

Source: Y. Kim and T. Moon, "Human detection and activity classification based on micro-Doppler
signatures using deep convolutional neural networks", IEEE Geosci. Remote Sens. Lett. 13 (2016):
three layers of 20 filters of 5 by 5, each with ReLU and pooling, then one full layer.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from benchmark_tasks import Elements

TITLE = "CNN on the spectrogram"
USES_VECTOR = False
_EPOCHS = 20
_BATCH = 50
"""As is Adam's rate, the usual one; not tuned on any task."""


def scores(train: Elements, test: Elements, seed: int) -> NDArray[np.float64]:
    """Return the probability of a person for every element of `test`."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return _scores(train, test)


def _scores(train: Elements, test: Elements) -> NDArray[np.float64]:
    x, y = torch.from_numpy(train.mu[:, None]), torch.from_numpy(train.is_person).long()
    net = _net(x)
    optimiser = torch.optim.Adam(net.parameters())
    for _ in range(_EPOCHS):
        for part in torch.split(torch.randperm(len(y)), _BATCH):
            optimiser.zero_grad()
            functional.cross_entropy(net(x[part]), y[part]).backward()  # type: ignore[no-untyped-call]
            optimiser.step()
    net.eval()
    with torch.no_grad():
        parts = torch.split(torch.from_numpy(test.mu[:, None]), 500)
        logits = torch.cat([net(part) for part in parts])
    return torch.softmax(logits.double(), dim=1)[:, 1].numpy()


def _net(x: torch.Tensor) -> nn.Sequential:
    layers: list[nn.Module] = []
    for n_in in (1, 20, 20):
        layers += [nn.Conv2d(n_in, 20, 5, padding=2), nn.ReLU(), nn.MaxPool2d(2)]
    body = nn.Sequential(*layers, nn.Flatten())
    n_flat = body(x[:1]).shape[1]
    return nn.Sequential(body, nn.Linear(n_flat, 50), nn.ReLU(), nn.Dropout(0.5), nn.Linear(50, 2))
