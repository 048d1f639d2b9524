"""Checkpoints of a training of hours: whole or not there, and good for the very same run only.

A training that goes on from one takes the same steps as one that was never interrupted.
"""

import hashlib
import io
import json
import pickle
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from torch import nn

from radard.judge.bundle import Bundle
from x2train.nets.optimizer import MuonAdamW
from x2train.sets.shards import write_whole

_EVERY_S = 300.0  # of wall clock: what an interruption costs at most
_DAMAGED = (
    OSError,
    RuntimeError,
    EOFError,
    TypeError,
    ValueError,
    LookupError,
    pickle.UnpicklingError,
)
"""What torch raises on files that are no checkpoints, or not whole."""


@dataclass(frozen=True, slots=True, eq=False)
class SavedPoint:
    """State of a training after so many steps of an epoch."""

    print: str  # of data and settings, see `fingerprint`
    epoch: int  # from 1
    step: int  # done in it
    total: float  # loss of these, summed over windows
    net: dict[str, Any]
    optimizer: list[dict[str, Any]]
    # states of the generators: at the epoch's beginning, which orders it; and now
    order: torch.Tensor
    now: torch.Tensor
    layers: torch.Tensor


def fingerprint(
    windows: Mapping[str, NDArray[Any]], settings: Any, taught: Any, start: Bundle | None = None
) -> str:
    """Return a digest of what a training depends on: settings, labels, size, some of the maps."""
    digest = hashlib.sha256(json.dumps(asdict(settings), sort_keys=True).encode())
    for name in sorted(windows):
        values = windows[name]
        digest.update(f"{name} {values.shape} {values.dtype}".encode())
        digest.update(values[:: max(1, len(values) // 1000)].tobytes())
    digest.update(windows["label"].tobytes())
    if taught is not None:
        digest.update(taught.tobytes())
    if start is not None:
        digest.update(start.onnx)
    return digest.hexdigest()


class Checkpoints:
    """A file that a training writes every few minutes and goes on from.

    Without a path nothing is written. Raises RecordingError where the disk refuses.
    """

    def __init__(self, path: Path | None, run: str, every_s: float = _EVERY_S) -> None:
        self._path = path
        self._run = run
        self._every_s = every_s
        self._next_s = time.monotonic() + every_s

    def resume(
        self, net: nn.Module, optimizer: MuonAdamW, rng: torch.Generator
    ) -> tuple[int, int, float]:
        """Put a training back; return epoch, steps done in it and their loss: 1, 0, 0 at first.

        The generator is put to the epoch's beginning; `at_step` puts it on from there.
        """
        point = self._read()
        if point is None:
            return 1, 0, 0.0
        net.load_state_dict(point.net)
        optimizer.load_state(point.optimizer)
        rng.set_state(point.order)
        self._resumed = point
        return point.epoch, point.step, point.total

    def at_step(self, rng: torch.Generator) -> None:
        """Put the generators to where the steps that were done have left them."""
        rng.set_state(self._resumed.now)
        torch.set_rng_state(self._resumed.layers)

    @property
    def is_due(self) -> bool:
        """Whether it is time for the next one."""
        return self._path is not None and time.monotonic() >= self._next_s

    def save(
        self,
        at: tuple[int, int, float],
        net: nn.Module,
        optimizer: MuonAdamW,
        order: torch.Tensor,
        rng: torch.Generator,
    ) -> None:
        """Write a checkpoint; `at` as `resume` returns it."""
        if self._path is None:
            return
        point = SavedPoint(
            self._run,
            *at,
            net.state_dict(),
            optimizer.state(),
            order,
            rng.get_state(),
            torch.get_rng_state(),
        )
        self._path.parent.mkdir(parents=True, exist_ok=True)
        data = io.BytesIO()
        torch.save({f.name: getattr(point, f.name) for f in fields(point)}, data)
        write_whole(self._path, data.getvalue())
        self._next_s = time.monotonic() + self._every_s

    def done(self) -> None:
        """Remove the file: the training has ended."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    def _read(self) -> SavedPoint | None:
        """Return the file's point; None if there is none, or it is of another run or damaged."""
        if self._path is None or not self._path.exists():
            return None
        try:
            # Nothing in a file runs code.
            point = SavedPoint(**torch.load(self._path, weights_only=True, map_location="cpu"))
        except _DAMAGED:
            return None
        return point if point.print == self._run else None
