"""Training of the map networks: weighted cross-entropy, Muon and AdamW, temperature after."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from radard.errors import UsageError
from radard.judge.bundle import Bundle
from radard.judge.installation import INSTALLATION, N_INSTALLATION
from x2train.nets.calibration import Epoch, cross_entropy, temperature_of
from x2train.nets.map_checkpoint import Checkpoints, fingerprint
from x2train.nets.nets import MapNet, Widths, start_from
from x2train.nets.optimizer import MuonAdamW
from x2train.sets.augment import augmented
from x2train.sets.window_set import hidden_more

Arrays = Mapping[str, NDArray[Any]]
MAPS = ("velocity_time", "range_time", "velocity_time_medium", "velocity_time_long")
INPUTS = (*MAPS, INSTALLATION)  # in the order in which `MapNet` takes them
_N_SHOWN = 512  # windows that open the norms of a network to go on from
_STARTED_RATE = 0.3  # of the learning rates, from a bundle: it is not to forget it


@dataclass(frozen=True, slots=True, kw_only=True)
class MapFitSettings:
    """Length, rates, regularisation and augmentation of a network's training."""

    epochs: int = 12
    batch: int = 128
    # greatest of the one cycle, of AdamW and of Muon; see `MuonAdamW`
    learning_rate: float = 4e-3
    matrix_rate: float = 0.06
    weight_decay: float = 2e-3
    matrix_decay: float = 1e-2
    dropout: float = 0.05  # of what decides
    smoothing: float = 0.01  # of the labels, where there is no teacher
    teacher_share: float = 0.5  # what a teacher counts beside the labels
    widths: Widths = (12, 16, 20, 20)
    long_widths: Widths = (12, 16, 20, 20)
    hidden: int = 40
    seed: int = 0  # of weights, order and augmentation
    threads: int = 1  # of torch; the same number, the same weights
    device: str = "cpu"  # of torch, such as 'cuda', which holds all windows
    is_half: bool = False  # whether layers compute in bfloat16; weights stay in single precision
    # whether torch compiles the network first, which takes a C++ compiler
    is_compiled: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class MapTrained:
    """A network, and the temperature that calibrates it."""

    net: MapNet
    temperature: float


def fit_maps(
    train: Arrays,
    validation: Arrays,
    settings: MapFitSettings,
    *,
    taught: NDArray[np.float32] | None = None,
    checkpoint: Path | None = None,
    start: Bundle | None = None,
) -> Iterator[Epoch | MapTrained]:
    """Train; yield every epoch, and at last the network, on the processor.

    Windows are `INPUTS`, maps as bytes, shape (n, rows, n_cells), and `label`; `taught`, shape (n,
    3), is what a teacher makes of those to train on. `checkpoint` is a file that an interrupted
    training goes on from; `start` a bundle of this size whose weights are gone on from. On a
    processor the same seed gives the same weights; a GPU adds in an order of its own.
    """
    torch.manual_seed(settings.seed)
    torch.set_num_threads(settings.threads)
    device = settings.device
    rng = torch.Generator(device).manual_seed(settings.seed)
    maps = [torch.from_numpy(train[name]).to(device) for name in MAPS]
    known = torch.from_numpy(train[INSTALLATION]).to(device)
    labels = torch.from_numpy(np.asarray(train["label"], np.int64)).to(device)
    net, optimizer = _beginning(maps, known, settings, start)
    # Every class weighs the same.
    counts = torch.bincount(labels.cpu(), minlength=3).float().to(labels.device)
    weight = counts.sum() / (3 * counts.clamp(min=1))
    shown = None if taught is None else torch.from_numpy(taught).to(device)
    # The last batch of an epoch is smaller: once more compiled, not made to fit any size.
    answer = torch.compile(net, dynamic=False) if settings.is_compiled else net
    run = fingerprint(train, settings, taught, start) if checkpoint else ""
    kept = Checkpoints(checkpoint, run)
    first, done, resumed = kept.resume(net, optimizer, rng)
    total: float | torch.Tensor = resumed
    for number in range(first, settings.epochs + 1):
        net.train()
        order = rng.get_state()
        parts = torch.split(
            torch.randperm(len(labels), generator=rng, device=device), settings.batch
        )
        if done:
            kept.at_step(rng)
        for step, part in enumerate(parts[done:], done + 1):
            shown_maps = augmented(*(m[part].float() / 255 for m in maps), rng=rng)
            batch = (*shown_maps, hidden_more(known[part], rng))
            with torch.autocast(device, torch.bfloat16, enabled=settings.is_half):
                answers = answer(*batch)
            said = None if shown is None else shown[part]
            loss = _error(answers.float(), labels[part], said, weight, settings)
            optimizer.step(loss)
            # Summed where it is: to fetch each would let a GPU wait.
            total = total + loss.detach().double() * len(part)
            if kept.is_due:
                kept.save((number, step, float(total)), net, optimizer, order, rng)
        logits = logits_of(net, validation)
        score = cross_entropy(logits, np.asarray(validation["label"]))
        yield Epoch(number, float(total) / len(labels), score)
        done, total = 0, 0.0
    kept.done()
    net.cpu()
    logits = logits_of(net, validation)
    yield MapTrained(net, temperature_of(logits, np.asarray(validation["label"])))


def _error(
    answers: torch.Tensor,
    labels: torch.Tensor,
    taught: torch.Tensor | None,
    weight: torch.Tensor,
    settings: MapFitSettings,
) -> torch.Tensor:
    """Return the cross-entropy of logits, (n, 3), with labels and, by its share, a teacher."""
    if taught is None:
        return functional.cross_entropy(
            answers, labels, weight, label_smoothing=settings.smoothing
        )
    wanted = settings.teacher_share * taught
    wanted[torch.arange(len(labels)), labels] += 1 - settings.teacher_share
    each = -(wanted * answers.log_softmax(1)).sum(1)
    return (each * weight[labels]).sum() / weight[labels].sum()


def device_of(wanted: str) -> str:
    """Return where torch trains: 'cpu' or 'cuda'; UsageError if a wanted GPU is not there."""
    if wanted == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if wanted == "cuda" and not torch.cuda.is_available():
        raise UsageError("--device cuda: torch finds no GPU here")
    return wanted


def _beginning(
    maps: list[torch.Tensor], known: torch.Tensor, settings: MapFitSettings, start: Bundle | None
) -> tuple[MapNet, MuonAdamW]:
    """Return the network with its first weights, and what takes its steps."""
    net = network(tuple(m.shape[1] for m in maps), settings)
    if start is not None:
        some = slice(0, None, max(1, len(known) // _N_SHOWN))
        start_from(net, start, [*(m[some].float() / 255 for m in maps), known[some]])
    n_steps = settings.epochs * -(-len(known) // settings.batch)
    return net, optimizer_of(net, n_steps, settings, 1.0 if start is None else _STARTED_RATE)


def network(rows: tuple[int, ...], settings: MapFitSettings) -> MapNet:
    """Return a network with random weights for maps of `INPUTS` with so many rows."""
    net = MapNet(
        rows[0],
        rows[1],
        rows[2:],
        n_known=N_INSTALLATION,
        widths=settings.widths,
        long_widths=settings.long_widths,
        hidden=settings.hidden,
        dropout=settings.dropout,
    )
    net.to(settings.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    return net


def optimizer_of(
    net: MapNet, n_steps: int, settings: MapFitSettings, share: float = 1.0
) -> MuonAdamW:
    """Return what takes `n_steps` steps, at so much of the learning rates."""
    return MuonAdamW(
        net,
        n_steps,
        rate=share * settings.learning_rate,
        matrix_rate=share * settings.matrix_rate,
        weight_decay=settings.weight_decay,
        matrix_decay=settings.matrix_decay,
    )


def logits_of(net: nn.Module, windows: Arrays) -> NDArray[np.float64]:
    """Return the logits of windows, shape (n, 3), by torch, where the network is."""
    net.eval()
    device = next(net.parameters()).device
    n = len(windows["label"])
    out = []
    with torch.no_grad():
        for first in range(0, n, 1024):
            rows = slice(first, first + 1024)
            maps = [torch.from_numpy(windows[n][rows]).to(device).float() / 255 for n in MAPS]
            known = torch.from_numpy(windows[INSTALLATION][rows]).to(device)
            out.append(net(*maps, known).cpu().numpy().astype(np.float64))
    return np.concatenate(out) if out else np.zeros((0, 3))
