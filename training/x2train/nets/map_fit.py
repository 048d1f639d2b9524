"""Training of the map networks: weighted cross-entropy, Muon and AdamW, temperature after.

Muon (K. Jordan et al., 2024, `torch.optim.Muon`) is for matrices, AdamW for all else, in one
cycle of both rates. A convolution is a matrix with a row for each channel; layers of few inputs or
few outputs are AdamW's. A training of hours goes on from its checkpoint when it was interrupted.

Batches of maps are changed in ways that a radar or a room could have changed them. They are not
turned round, approaching for leaving: networks that learn from such maps as well do worse
(docs/research/evaluation-tried.md).
"""

import hashlib
import io
import json
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

from radard.errors import UsageError
from radard.judge.bundle import Bundle
from radard.judge.installation import INSTALLATION
from x2radar.atomic import write_whole
from x2train.nets.calibration import Epoch, Trained, cross_entropy, temperature_of
from x2train.nets.nets import MapFitSettings, MapNet, start_from

Arrays = Mapping[str, NDArray[Any]]
MAPS = ("velocity_time", "range_time", "velocity_time_medium", "velocity_time_long")
INPUTS = (*MAPS, INSTALLATION)  # in the order in which `MapNet` takes them
_N_SHOWN = 512  # windows that open the norms of a network to go on from
_RISE = 0.2  # of the steps: as usual for one cycle
_MIN_ROWS, _MIN_COLUMNS = 4, 31  # the layers named above are smaller
_STARTED_RATE = 0.3  # of the learning rates, from a bundle: it is not to forget it
_EVERY_S = 300.0  # between checkpoints, by the wall clock: what an interruption costs at most
_MAX_SHIFT = 12  # cells: 0.6 m
_FLOOR_SHARE, _MAX_FLOOR, _SPECKLE = 0.4, 0.6, 0.08  # of windows; of the scale; likewise
_CUT_SHARE, _LOST_SHARE = 0.3, 0.15  # of windows
_HIDDEN_SHARE = 0.15  # of windows, for each of height, tilt and strength, in training


class MuonAdamW:
    """AdamW at a `share` of the rate and, for matrices, Muon at its own, in one cycle of both."""

    def __init__(
        self, net: nn.Module, n_steps: int, settings: MapFitSettings, share: float = 1.0
    ) -> None:
        rate, matrix_rate = share * settings.learning_rate, share * settings.matrix_rate
        self._matrices = [p for p in net.parameters() if _is_matrix(p)]
        # Muon takes nothing but matrices, so it is given views of the same memory.
        self._views = [nn.Parameter(_flat(p.data, p)) for p in self._matrices]
        others = [p for p in net.parameters() if not _is_matrix(p)]
        self._optimisers: tuple[torch.optim.Optimizer, ...] = (
            torch.optim.AdamW(others, lr=rate, weight_decay=settings.weight_decay),
            torch.optim.Muon(self._views, lr=matrix_rate, weight_decay=settings.matrix_decay),
        )
        # OneCycleLR divides by zero where the rise is one step long.
        rise = _RISE if n_steps * _RISE != 1 else 1.5 * _RISE
        self._cycles = [
            torch.optim.lr_scheduler.OneCycleLR(
                each, most, total_steps=n_steps, pct_start=rise, cycle_momentum=False
            )
            for each, most in zip(self._optimisers, (rate, matrix_rate), strict=True)
        ]
        self.parts: tuple[Any, ...] = (*self._optimisers, *self._cycles)  # all that has a state
        self._net = net

    def step(self, loss: torch.Tensor) -> None:
        """Take one step down a loss."""
        self._net.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        for p, view in zip(self._matrices, self._views, strict=True):
            view.grad = None if p.grad is None else _flat(p.grad, p)
        for optimiser, cycle in zip(self._optimisers, self._cycles, strict=True):
            optimiser.step()
            cycle.step()


def _is_matrix(p: torch.Tensor) -> bool:
    return p.ndim > 1 and p.shape[0] >= _MIN_ROWS and p.numel() >= _MIN_COLUMNS * p.shape[0]


def _flat(p: torch.Tensor, like: torch.Tensor) -> torch.Tensor:
    """Return weights as a matrix whose columns are in the order of the memory of `like`."""
    is_last = like.ndim == 4 and like.is_contiguous(memory_format=torch.channels_last)
    return (p.permute(0, 2, 3, 1) if is_last else p).flatten(1)


def fit_maps(
    train: Arrays,
    validation: Arrays,
    settings: MapFitSettings,
    *,
    taught: NDArray[np.float32] | None = None,
    checkpoint: Path | None = None,
    start: Bundle | None = None,
) -> Iterator[Epoch | Trained[MapNet]]:
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
    run = _fingerprint(train, settings, taught, start) if checkpoint else ""
    kept = _Checkpoints(checkpoint, run, (net, *optimizer.parts), rng)
    total: float | torch.Tensor
    first, done, total, order = kept.resume()
    for number in range(first, settings.epochs + 1):
        net.train()
        if order is None:
            order = torch.randperm(len(labels), generator=rng, device=device)
        for step, part in enumerate(torch.split(order, settings.batch)[done:], done + 1):
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
                kept.save(epoch=number, step=step, total=float(total), order=order)
        logits = logits_of(net, validation)
        score = cross_entropy(logits, np.asarray(validation["label"]))
        yield Epoch(number, float(total) / len(labels), score)
        done, total, order = 0, 0.0, None
    kept.done()
    net.cpu()
    logits = logits_of(net, validation)
    yield Trained(net, temperature_of(logits, np.asarray(validation["label"])))


def _fingerprint(
    windows: Arrays, settings: MapFitSettings, taught: NDArray[Any] | None, start: Bundle | None
) -> str:
    """Return a digest of what a training depends on: settings, answers, some of the maps."""
    digest = hashlib.sha256(json.dumps(asdict(settings), sort_keys=True).encode())
    digest.update(start.onnx if start else b"")
    given = dict(windows) if taught is None else {**windows, "taught": taught}
    for name, values in sorted(given.items()):
        digest.update(f"{name} {values.shape} {values.dtype}".encode())
        few = 1 if name in {"label", "taught"} else max(1, len(values) // 1000)
        digest.update(values[::few].tobytes())
    return digest.hexdigest()


class _Checkpoints:
    """A file that a training writes now and then, and goes on from as if it had not stopped."""

    def __init__(
        self, path: Path | None, run: str, parts: tuple[Any, ...], rng: torch.Generator
    ) -> None:
        self._path, self._run, self._parts, self._rng = path, run, parts, rng
        self._next_s = time.monotonic() + _EVERY_S

    def resume(self) -> tuple[int, int, float, torch.Tensor | None]:
        """Put a training back; return epoch, steps done in it, their loss, and its order."""
        point: Any = {}
        # Damaged, or of another run, it is begun afresh; whatever is in it, no code is run.
        with suppress(Exception):
            if self._path is not None and self._path.exists():
                point = torch.load(self._path, weights_only=True, map_location="cpu")
        if not isinstance(point, dict) or point.get("run") != self._run:
            return 1, 0, 0.0, None
        for part, state in zip(self._parts, point["parts"], strict=True):
            part.load_state_dict(state)
        self._rng.set_state(point["rng"])
        torch.set_rng_state(point["layers"])
        return point["epoch"], point["step"], point["total"], point["order"].to(self._rng.device)

    @property
    def is_due(self) -> bool:
        """Whether it is time for the next one."""
        return self._path is not None and time.monotonic() >= self._next_s

    def save(self, **at: float | torch.Tensor) -> None:
        """Write a checkpoint, whole or not at all; `at` is what `resume` returns, by name."""
        assert self._path is not None  # noqa: S101 - it is due
        point = {
            "run": self._run,
            "parts": [part.state_dict() for part in self._parts],
            "rng": self._rng.get_state(),
            "layers": torch.get_rng_state(),
            **at,
        }
        self._path.parent.mkdir(parents=True, exist_ok=True)
        data = io.BytesIO()
        torch.save(point, data)
        write_whole(self._path, data.getvalue())
        self._next_s = time.monotonic() + _EVERY_S

    def done(self) -> None:
        """Remove the file: the training has ended."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)


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
    net = MapNet(tuple(m.shape[1] for m in maps), settings)
    if start is not None:
        some = slice(0, None, max(1, len(known) // _N_SHOWN))
        start_from(net, start, [*(m[some].float() / 255 for m in maps), known[some]])
    n_steps = settings.epochs * -(-len(known) // settings.batch)
    return net, MuonAdamW(net, n_steps, settings, 1.0 if start is None else _STARTED_RATE)


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


def augmented(
    velocity: torch.Tensor, ranges: torch.Tensor, *long: torch.Tensor, rng: torch.Generator
) -> tuple[torch.Tensor, ...]:
    """Return changed copies of maps, 0 to 1, each of shape (n, rows, n_cells), by `rng`."""
    n, _, n_cells = velocity.shape
    u = torch.rand(n, 7, generator=rng, device=rng.device)
    ranges = _shifted(ranges, u[:, 0])
    slow = [_noisier(_deeper(each, u[:, 1]), u[:, 3], rng) for each in (velocity, *long)]
    ranges = _noisier(_deeper(ranges, u[:, 2]), u[:, 3], rng)
    keep, is_lost = _kept(u[:, 4:], n_cells)
    # A lost frame leaves no whole CPI to a long map, and few to a medium one.
    whole = (~is_lost).float()[:, None, None]
    velocity, *long_maps = slow
    kept = keep[:, None]
    return velocity * kept, ranges * kept, *(each * whole for each in long_maps)


def _shifted(ranges: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
    """Move each map along range; what comes in is empty."""
    n_rows = ranges.shape[1]
    shift = (u * (2 * _MAX_SHIFT + 1)).floor().long() - _MAX_SHIFT
    source = torch.arange(n_rows, device=u.device)[None] - shift[:, None]
    inside = (source >= 0) & (source < n_rows)
    index = source.clamp(0, n_rows - 1)[:, :, None].expand(-1, -1, ranges.shape[2])
    return ranges.gather(1, index) * inside[:, :, None]


def _deeper(maps: torch.Tensor, u: torch.Tensor) -> torch.Tensor:
    """Stretch the decibels under the reference by 0.8 to 1.25; what is empty stays so."""
    factor = 0.8 * (1.25 / 0.8) ** u
    stretched = (1 - (1 - maps) * factor[:, None, None]).clamp(0, 1)
    return torch.where(maps > 0, stretched, maps)


def _noisier(maps: torch.Tensor, u: torch.Tensor, rng: torch.Generator) -> torch.Tensor:
    """Lay a speckled floor under some of the maps."""
    rows = torch.nonzero(u < _FLOOR_SHARE)[:, 0]
    level = (_MAX_FLOOR * u[rows] / _FLOOR_SHARE)[:, None, None]
    speckle = _SPECKLE * torch.randn(maps[rows].shape, generator=rng, device=rng.device)
    lit = maps.amax(2, keepdim=True)[rows] > 0
    made = maps.clone()
    made[rows] = torch.where(lit, torch.maximum(maps[rows], level + speckle), 0.0).clamp(0, 1)
    return made


def _kept(u: torch.Tensor, n_cells: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Return which time cells stay, shape (n, n_cells), and in whose middle some are lost."""
    at = torch.arange(n_cells, device=u.device)[None] / n_cells
    size = 0.35 * u[:, 1:2]
    is_cut = u[:, 0:1] < _CUT_SHARE
    cut = is_cut & torch.where(u[:, 2:3] < 0.5, at < size, at >= 1 - size)
    is_lost = (u[:, 0:1] >= _CUT_SHARE) & (u[:, 0:1] < _CUT_SHARE + _LOST_SHARE)
    lost = is_lost & ((at - u[:, 2:3]).abs() < 0.05)
    return (~(cut | lost)).float(), is_lost[:, 0]


def hidden_more(known: torch.Tensor, rng: torch.Generator) -> torch.Tensor:
    """Return a batch of inputs, shape (n, `N_INSTALLATION`), with more of them missing."""
    kept = torch.rand(len(known), 3, generator=rng, device=rng.device) >= _HIDDEN_SHARE
    pairs = kept.repeat_interleave(2, dim=1)
    always = torch.ones(len(known), 1, device=rng.device)
    return known * torch.cat([always, pairs], 1)
