"""Networks of the shipped bundles in torch: branches over maps, their sizes, and a beginning."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import onnx
import torch
from numpy.typing import NDArray
from onnx import numpy_helper
from torch import nn

from radard.errors import UsageError
from radard.judge.bundle import Bundle
from radard.judge.installation import N_INSTALLATION

Widths = tuple[int, int, int, int]
_KNOWN = 16  # units for what is known besides the maps
_NORMS = (nn.BatchNorm1d, nn.BatchNorm2d)


@dataclass(frozen=True, slots=True)
class MapFitSettings:
    """Length, rates, regularisation and augmentation of a network's training."""

    # channels of a branch's convolutions, of those with longer CPIs, and behind the junction
    widths: Widths = (12, 16, 20, 20)
    long_widths: Widths = (12, 16, 20, 20)
    hidden: int = 40
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
    seed: int = 0  # of weights, order and augmentation
    threads: int = 1  # of torch; the same number, the same weights
    device: str = "cpu"  # of torch, such as 'cuda', which holds all windows
    is_half: bool = False  # whether layers compute in bfloat16; weights stay in single precision
    # whether torch compiles the network first, which takes a C++ compiler
    is_compiled: bool = False


class MapNet(nn.Module):
    """Strided convolutional branches over maps: two of the same time, others of their own.

    Each branch halves velocity or range four times and time twice. Those of the velocity-time and
    the range-time map are joined time by time, and a convolution over time mixes them; maps with
    longer CPIs have fewer columns of time and are joined after it. `rows` are those of each map,
    in this order. Mean and maximum over time decide, with what is known of the installation.
    Strides instead of pooling: three times as fast on one core.
    """

    def __init__(self, rows: tuple[int, ...], settings: MapFitSettings) -> None:
        super().__init__()
        widths, long_widths, hidden = settings.widths, settings.long_widths, settings.hidden
        self.velocity = _branch(widths)
        self.range = _branch(widths)
        first, second, *longer = (_strided(n) for n in rows)
        self.junction = _block(nn.Conv1d(widths[-1] * (first + second), hidden, 1, bias=False))
        self.mix = _block(nn.Conv1d(hidden, hidden, 3, padding=1, bias=False))
        self.long = nn.ModuleList(_branch(long_widths) for _ in longer)
        self.long_junctions = nn.ModuleList(
            _block(nn.Conv1d(long_widths[-1] * n, hidden // 2, 1, bias=False)) for n in longer
        )
        self.known = nn.Sequential(nn.Linear(N_INSTALLATION, _KNOWN), nn.ReLU())
        n_deciding = 2 * hidden + len(longer) * 2 * (hidden // 2) + _KNOWN
        self.out = nn.Sequential(nn.Dropout(settings.dropout), nn.Linear(n_deciding, 3))
        self.to(settings.device, memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, *given: torch.Tensor) -> torch.Tensor:
        """Return logits, shape (n, 3), of maps, each of shape (n, rows, n_cells).

        Velocity-time, range-time, then those with longer CPIs; and the installation.
        """
        *maps, last = given
        known = self.known(last)
        first, second, *longer = (
            branch(each[:, None]).flatten(1, 2)
            for branch, each in zip((self.velocity, self.range, *self.long), maps, strict=True)
        )
        joined = self.junction(torch.cat([first, second], 1))
        deciding = [joined + self.mix(joined)]
        deciding += [join(each) for join, each in zip(self.long_junctions, longer, strict=True)]
        pooled = [pool for each in deciding for pool in (each.mean(2), each.amax(2))]
        logits: torch.Tensor = self.out(torch.cat([*pooled, known], 1))
        return logits


def _branch(widths: Widths) -> nn.Sequential:
    a, b, c, d = widths
    return nn.Sequential(
        _block(nn.Conv2d(1, a, 5, 2, 2, bias=False)),
        _block(nn.Conv2d(a, b, 3, 2, 1, bias=False)),
        _block(nn.Conv2d(b, c, 3, (2, 1), 1, bias=False)),
        _block(nn.Conv2d(c, d, 3, (2, 1), 1, bias=False)),
    )


def _block(layer: nn.Conv1d | nn.Conv2d) -> nn.Sequential:
    norm = nn.BatchNorm1d if isinstance(layer, nn.Conv1d) else nn.BatchNorm2d
    return nn.Sequential(layer, norm(layer.out_channels), nn.ReLU())


def _strided(n_rows: int) -> int:
    for _ in range(4):
        n_rows = (n_rows + 1) // 2
    return n_rows


def start_from(net: MapNet, bundle: Bundle, windows: Sequence[torch.Tensor]) -> None:
    """Give a network a bundle's weights; UsageError if it is of another kind or size.

    Norms are folded into a bundle's convolutions. Here each is opened again: what `windows` make
    of the convolution gives its mean and spread, and its scale and offset are set so that the
    network says what the bundle says. From there training goes on as if it had never stopped.
    """
    model = onnx.load_from_string(bundle.onnx)
    found = {each.name: numpy_helper.to_array(each) for each in model.graph.initializer}
    hooks = []
    for name, module in net.named_modules():
        if isinstance(module, nn.Sequential) and len(module) > 1 and isinstance(module[1], _NORMS):
            layer: Any = module[0]
            norm: Any = module[1]
            _take(bundle, layer.weight, found, f"{name}.0.weight")
            bias = torch.empty_like(norm.bias)
            _take(bundle, bias, found, f"{name}.0.weight_bias")
            hooks.append(norm.register_forward_pre_hook(_opened(bias)))
        elif isinstance(module, nn.Linear):
            for part in ("weight", "bias"):
                _take(bundle, getattr(module, part), found, f"{name}.{part}")
    net.eval()
    with torch.no_grad():
        net(*windows)
    for hook in hooks:
        hook.remove()


def _take(bundle: Bundle, own: torch.Tensor, found: Mapping[str, NDArray[Any]], name: str) -> None:
    values = found.get(name)
    if values is None or values.shape != tuple(own.shape):
        shape = None if values is None else values.shape
        msg = f"model '{bundle.name}': {name} is {shape}, this size has {tuple(own.shape)}"
        raise UsageError(msg)
    own.data.copy_(torch.from_numpy(values.copy()))


def _opened(bias: torch.Tensor) -> Callable[[nn.Module, Any], None]:
    """Return a hook that opens a norm: what it is given, plus `bias`, is what it gives."""

    def hook(norm: Any, given: tuple[torch.Tensor, ...]) -> None:
        axes = [0, *range(2, given[0].ndim)]
        mean, variance = given[0].mean(axes), given[0].var(axes, unbiased=False)
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
        norm.weight.data.copy_((variance + norm.eps).sqrt())
        norm.bias.data.copy_(bias + mean)

    return hook
