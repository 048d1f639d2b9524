"""Networks in torch."""

import torch
from torch import nn


class SeedNet(nn.Module):
    """The seed's feed-forward network Q-100-50-2 with ReLU; gives logits.

    Parameters
    ----------
    n_in : int
        Length of the feature vector, 784 (type 1) or 1176 (type 2).
    n_out : int
        Classes.
    """

    def __init__(self, n_in: int, n_out: int = 2) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(n_in, 100), nn.ReLU(), nn.Linear(100, 50), nn.ReLU(), nn.Linear(50, n_out)
        )
        for layer in self.layers:
            if isinstance(layer, nn.Linear):
                nn.init.xavier_uniform_(layer.weight)
                nn.init.zeros_(layer.bias)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return logits, shape (n, n_out), of features, shape (n, n_in)."""
        logits: torch.Tensor = self.layers(x)
        return logits
