"""Checkpoints of a training: whole or not there, and good for the very same run only."""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import torch

from x2train.nets.checkpoint_file import read_checkpoint, write_checkpoint
from x2train.thesis.mlp import RepeatedMlp
from x2train.thesis.sets import CellData
from x2train.thesis.settings import FitSettings

State = dict[str, torch.Tensor]


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """Everything that a training goes on from."""

    print: str  # of data and settings
    epoch: int
    steps: int
    # weights: as they are, their running mean, every repeat's best
    net: State
    mean_net: State
    best: State
    # of the looks so far
    best_score: list[float]
    scores: list[list[float]]
    confidence: list[list[list[float]]]
    order: torch.Tensor  # state of the generator that orders elements


def fingerprint(data: Iterable[CellData], settings: FitSettings, start: RepeatedMlp | None) -> str:
    """Return a digest of all that a training depends on."""
    digest = hashlib.sha256(json.dumps(asdict(settings), sort_keys=True).encode())
    for part in data:
        digest.update(part.x.tobytes())
        digest.update(part.y.tobytes())
    if start is not None:
        for value in start.state_dict().values():
            digest.update(value.cpu().numpy().tobytes())
    return digest.hexdigest()


def save_checkpoint(path: Path, point: Checkpoint) -> None:
    """Write a checkpoint, whole or not at all; raise RecordingError if the disk refuses."""
    write_checkpoint(path, {f.name: getattr(point, f.name) for f in fields(point)})


def load_checkpoint(path: Path) -> Checkpoint | None:
    """Return a checkpoint; None if there is none that can be trusted."""
    known = read_checkpoint(path)
    if known is None or known.keys() != {f.name for f in fields(Checkpoint)}:
        return None
    return Checkpoint(**known)
