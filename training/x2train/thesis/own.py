"""What else was tried on the thesis' elements: the project's own features, and raw frames.

The thesis sums power over range before its network sees anything. Here the network gets two
maps of the same frames, as the daemon makes them: the micro-Doppler spectrogram in decibels,
and the range-time map, each set against its own level (`radard.judge.velocity_map`).

Raw frames have no features between (5.2.4): an element's baseband frames, every 16th bin of them,
which is about the pulse's width; real and imaginary parts, scaled together to unit norm, as the
vectors are.
"""

from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from x2train.sets import workers
from x2train.thesis.elements import ElementSpec, dwell
from x2train.thesis.fit import FitSettings, Tell, fit
from x2train.thesis.recipe import FRESH_FROM, Job, StudyRecipe, reached, scores, with_stop
from x2train.thesis.sets import Cell, CellData, load_maps

Maps = dict[str, NDArray[np.float32]]
OWN, RAW = "own", "raw frames"
_DECIMATION = 16
_AT_ONCE = 500  # maps: some megabytes between the layers


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnSettings:
    """How the map network is trained."""

    channels: tuple[int, int, int] = (8, 16, 32)  # of the three layers of either branch
    hidden: int = 64
    dropout: float = 0.3  # share of units left out while training
    # of AdamW; the rate rises and falls once
    learning_rate: float = 0.002
    decay: float = 0.01
    batch: int = 64
    epochs: int = 30
    repeats: int = 1  # initial weights
    seed: int = 0  # of weights, order and dropout


class TwoMapNet(nn.Module):
    """Three convolutions on each map of `shapes`, then both together."""

    def __init__(self, shapes: dict[str, tuple[int, ...]], settings: OwnSettings) -> None:
        super().__init__()
        self.branches = nn.ModuleDict({name: _branch(settings.channels) for name in shapes})
        n_in = sum(settings.channels[-1] * (r // 8) * (c // 8) for r, c in shapes.values())
        self.head = nn.Sequential(
            nn.Dropout(settings.dropout),
            nn.Linear(n_in, settings.hidden),
            nn.ReLU(),
            nn.Dropout(settings.dropout),
            nn.Linear(settings.hidden, 2),
        )

    def forward(self, maps: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return logits, shape (n, 2), of maps of shape (n, 1, rows, columns)."""
        seen_maps = [branch(maps[name]).flatten(1) for name, branch in self.branches.items()]
        logits: torch.Tensor = self.head(torch.cat(seen_maps, dim=1))
        return logits


def _branch(channels: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for n_in, n_out in pairwise((1, *channels)):
        layers += [nn.Conv2d(n_in, n_out, 3, padding=1, bias=False), nn.BatchNorm2d(n_out)]
        layers += [nn.ReLU(), nn.MaxPool2d(2)]
    return nn.Sequential(*layers)


def train_maps(
    maps: Maps, y: NDArray[np.int64], s: OwnSettings, tell: workers.Tell = lambda *_: None
) -> TwoMapNet:
    """Return a network trained on two maps of every element with labels `y`."""
    inputs = {name: torch.from_numpy(values[:, None]) for name, values in maps.items()}
    wanted = torch.from_numpy(y)
    n_steps = s.epochs * -(-len(y) // s.batch)
    # Initial weights and dropout draw from torch's own generator: lent, and given back.
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(s.seed)
        net = TwoMapNet({name: values.shape[1:] for name, values in maps.items()}, s)
        optimiser = torch.optim.AdamW(net.parameters(), s.learning_rate, weight_decay=s.decay)
        rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, s.learning_rate, total_steps=n_steps)
        for epoch in range(1, s.epochs + 1):
            for part in torch.split(torch.randperm(len(y)), s.batch):
                optimiser.zero_grad()
                logits = net({name: values[part] for name, values in inputs.items()})
                functional.cross_entropy(logits, wanted[part]).backward()  # type: ignore[no-untyped-call]
                optimiser.step()
                rate.step()
            tell(epoch, s.epochs)
    return net.eval()


def predict_maps(net: TwoMapNet, maps: Maps) -> NDArray[np.float64]:
    """Return probabilities, shape (n, 2), float64."""
    inputs = {name: torch.from_numpy(values[:, None]) for name, values in maps.items()}
    n = len(next(iter(maps.values())))
    parts = (slice(at, at + _AT_ONCE) for at in range(0, n, _AT_ONCE))
    with torch.no_grad():
        logits = [net({name: values[part] for name, values in inputs.items()}) for part in parts]
    return torch.softmax(torch.cat(logits).double(), dim=1).numpy()


def own_job(recipe: StudyRecipe, cell: Cell, s: OwnSettings) -> Job:
    """Return the training of the map network on one set, whatever its vector."""
    name, n_train = cell.name[2:], recipe.n_train  # without its vector: D60

    def train(tell: Tell) -> dict[str, Any]:
        spec = recipe.spec(cell.frame_rate_hz)
        recipe.make(spec, cell, tell)
        maps, data = load_maps(recipe.folder, spec, cell, 0, recipe.n_elements)
        fresh_maps, fresh = load_maps(recipe.folder, spec, cell, FRESH_FROM, recipe.n_fresh)
        part = {key: values[:n_train] for key, values in maps.items()}
        rest = {key: values[n_train:] for key, values in maps.items()}
        p_evaluate, p_fresh = [], []
        for k in range(s.repeats):
            done = partial(tell, f"{name} map network {k + 1}")
            net = train_maps(part, data.y[:n_train], replace(s, seed=s.seed + k), done)
            p_evaluate.append(predict_maps(net, rest))
            p_fresh.append(predict_maps(net, fresh_maps))
        return {
            "best": 0,
            "epochs": (s.epochs,) * s.repeats,
            **scores(np.stack(p_evaluate), data.y[n_train:], np.stack(p_fresh), fresh),
            "stopped_by": "nothing: a fixed number of epochs",
        }

    settings = {**asdict(s), **_sizes(recipe), "n_cpi": recipe.n_cpi}
    return Job(recipe.folder, name, OWN, settings, train)


def raw_job(recipe: StudyRecipe, cell: Cell, s: FitSettings) -> Job:
    """Return the training of the thesis' network on the frames of one set."""

    def train(tell: Tell) -> dict[str, Any]:
        spec = recipe.spec(cell.frame_rate_hz)
        whole = raw_frames(spec, cell, 0, recipe.n_elements, tell)
        part, stop, stopped_by = with_stop(whole.part(0, recipe.n_train))
        fitted = fit(part, stop, s, tell=lambda what, *far: tell(f"{cell.name} {what}", *far))
        evaluate = whole.part(recipe.n_train, recipe.n_elements)
        fresh = raw_frames(spec, cell, FRESH_FROM, recipe.n_fresh, tell)
        return reached(fitted, s.look_every, evaluate, fresh, stopped_by)

    settings = {"fit": asdict(s), "decimation": _DECIMATION, **_sizes(recipe)}
    return Job(recipe.folder, cell.name, RAW, settings, train)


def _sizes(recipe: StudyRecipe) -> dict[str, int]:
    return {"elements": recipe.n_elements, "fresh": recipe.n_fresh, "data_seed": recipe.seed}


def raw_frames(spec: ElementSpec, cell: Cell, first: int, n: int, tell: Tell) -> CellData:
    """Return frames of `n` elements of a set, animal and person in turn, a row each."""
    rows: list[NDArray[np.float32]] = []
    in_view: list[float] = []
    for k in range(n // 2):
        for body in (cell.bodies[k % len(cell.bodies)], "human"):
            made, share = dwell(spec, body, first + k)
            bins = made.frames[:, ::_DECIMATION]
            row = np.concatenate([bins.real, bins.imag]).astype(np.float32).ravel()
            rows.append(row / max(float(np.linalg.norm(row)), 1e-30))
            in_view.append(share)
        tell(f"frames of {cell.name[2:]}", k + 1, n // 2)
    return CellData.in_turn(np.stack(rows), np.array(in_view, np.float32))
