"""Checkpoints of a training of hours: whole or not there, and good for the very same run only.

A training that goes on from one takes the same steps as one that was never interrupted.
"""

import hashlib
import io
import json
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from torch import nn

from radard.judge.bundle import Bundle
from x2radar.atomic import write_whole

_EVERY_S = 300.0  # of wall clock: what an interruption costs at most


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
    """A file that a training writes every few minutes and goes on from; or RecordingError."""

    def __init__(self, path: Path | None, run: str) -> None:
        self._path = path
        self._run = run
        self._next_s = time.monotonic() + _EVERY_S

    def resume(
        self, net: nn.Module, optimizer: Sequence[Any], rng: torch.Generator
    ) -> tuple[int, int, float]:
        """Put a training back; return epoch, steps done in it and their loss: 1, 0, 0 at first."""
        point: Any = {}
        # Damaged, or of another run, it is begun afresh; whatever is in it, no code is run.
        with suppress(Exception):
            if self._path is not None and self._path.exists():
                point = torch.load(self._path, weights_only=True, map_location="cpu")
        if not isinstance(point, dict) or point.get("print") != self._run:
            return 1, 0, 0.0
        self._point = point
        net.load_state_dict(point["net"])
        for part, state in zip(optimizer, point["optimizer"], strict=True):
            part.load_state_dict(state)
        rng.set_state(point["order"])
        return point["epoch"], point["step"], point["total"]

    def at_step(self, rng: torch.Generator) -> None:
        """Put the generators to where the steps that were done have left them."""
        rng.set_state(self._point["now"])
        torch.set_rng_state(self._point["layers"])

    @property
    def is_due(self) -> bool:
        """Whether it is time for the next one."""
        return self._path is not None and time.monotonic() >= self._next_s

    def save(
        self,
        at: tuple[int, int, float],
        net: nn.Module,
        optimizer: Sequence[Any],
        order: torch.Tensor,
        rng: torch.Generator,
    ) -> None:
        """Write a checkpoint; `at` as `resume` returns it."""
        if self._path is None:
            return
        epoch, step, total = at
        point = {
            "print": self._run,
            "epoch": epoch,  # from 1
            "step": step,  # steps done in it,
            "total": total,  # and their loss
            "net": net.state_dict(),
            "optimizer": [part.state_dict() for part in optimizer],
            # States of generators: at the epoch's beginning, which orders it; now; of layers, now.
            "order": order,
            "now": rng.get_state(),
            "layers": torch.get_rng_state(),
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
