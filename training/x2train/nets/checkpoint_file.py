"""Files of checkpoints: whole or not there, and nothing in them that runs code."""

import io
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from x2train.sets.shards import write_whole

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


def write_checkpoint(path: Path, fields: Mapping[str, Any]) -> None:
    """Write a checkpoint's fields; raise RecordingError if the disk refuses."""
    data = io.BytesIO()
    torch.save(dict(fields), data)
    write_whole(path, data.getvalue())


def read_checkpoint(path: Path) -> Mapping[str, Any] | None:
    """Return a checkpoint's fields; None if there is none, or none that can be trusted."""
    if not path.exists():
        return None
    try:
        fields = torch.load(path, weights_only=True, map_location="cpu")
    except _DAMAGED:
        return None
    return fields if isinstance(fields, dict) else None
