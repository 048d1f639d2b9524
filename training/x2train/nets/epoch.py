"""What every training has: epochs to tell of, and a temperature that calibrates its logits."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Epoch:
    """Progress of a training; None where nothing is kept apart to validate on."""

    number: int
    loss: float
    validation_loss: float | None = None


def temperature_of(logits: np.ndarray, y: np.ndarray) -> float:
    """Return the temperature with the lowest cross-entropy, to 1 %."""
    grid = np.geomspace(0.25, 8, 350)
    losses = []
    for t in grid:
        z = logits / t
        z = z - z.max(axis=1, keepdims=True)
        log_p = z - np.log(np.exp(z).sum(axis=1, keepdims=True))
        losses.append(-log_p[np.arange(len(y)), y].mean())
    return float(round(grid[int(np.argmin(losses))], 3))
