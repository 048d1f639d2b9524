"""Steps of training: Muon for matrices, AdamW for everything else, one cycle of both rates.

Muon: K. Jordan et al., 2024 (`torch.optim.Muon`). A convolution is a matrix with a row for each
channel; layers of few inputs or few outputs are AdamW's.
"""

from typing import Any

import torch
from torch import nn

_RISE = 0.2  # of the steps: as usual for one cycle
_MIN_ROWS, _MIN_COLUMNS = 4, 31  # the layers named above are smaller


class MuonAdamW:
    """AdamW at `rate` and, for matrices, Muon at `matrix_rate`, in one cycle of `n_steps`."""

    def __init__(
        self,
        net: nn.Module,
        n_steps: int,
        *,
        rate: float,
        matrix_rate: float,
        weight_decay: float,
        matrix_decay: float,
    ) -> None:
        self._matrices = [p for p in net.parameters() if _is_matrix(p)]
        # Muon takes nothing but matrices, so it is given views of the same memory.
        self._views = [nn.Parameter(_flat(p.data, p)) for p in self._matrices]
        others = [p for p in net.parameters() if not _is_matrix(p)]
        self._optimisers: tuple[torch.optim.Optimizer, ...] = (
            torch.optim.AdamW(others, lr=rate, weight_decay=weight_decay),
            torch.optim.Muon(self._views, lr=matrix_rate, weight_decay=matrix_decay),
        )
        # OneCycleLR divides by zero where the rise is one step long.
        rise = _RISE if n_steps * _RISE != 1 else 1.5 * _RISE
        self._cycles = [
            torch.optim.lr_scheduler.OneCycleLR(
                each, most, total_steps=n_steps, pct_start=rise, cycle_momentum=False
            )
            for each, most in zip(self._optimisers, (rate, matrix_rate), strict=True)
        ]
        self._parts: tuple[Any, ...] = (*self._optimisers, *self._cycles)
        self._net = net

    def state(self) -> list[dict[str, Any]]:
        """Return everything that `load_state` needs to go on."""
        return [each.state_dict() for each in self._parts]

    def load_state(self, state: list[dict[str, Any]]) -> None:
        """Go on from where another one for the same network and steps was."""
        for each, values in zip(self._parts, state, strict=True):
            each.load_state_dict(values)

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
