"""Augmentation: batches of maps changed in ways that a radar or a room could have changed them.

Maps are not turned round, approaching for leaving: networks that learn from such maps as well do
worse (docs/research/evaluation-tried.md).
"""

import torch

_MAX_SHIFT = 12  # cells: 0.6 m
_FLOOR_SHARE, _MAX_FLOOR, _SPECKLE = 0.4, 0.6, 0.08  # of windows; of the scale; likewise
_CUT_SHARE, _LOST_SHARE = 0.3, 0.15  # of windows


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
