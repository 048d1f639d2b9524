"""A network that goes on from a bundle's: its weights, put where training goes on from.

Norms are folded into a bundle's convolutions. Here each is opened again: what windows make of the
convolution gives its mean and spread, and its scale and offset are set so that the network says
what the bundle says. From there training goes on as if it had never stopped.
"""

from collections.abc import Callable, Sequence
from typing import Any

import onnx
import torch
from numpy.typing import NDArray
from onnx import numpy_helper
from torch import nn

from radard.errors import UsageError
from radard.judge.bundle import Bundle
from x2train.nets.nets import MapNet

_NORMS = (nn.BatchNorm1d, nn.BatchNorm2d)


def start_from(net: MapNet, bundle: Bundle, windows: Sequence[torch.Tensor]) -> None:
    """Give a network a bundle's weights; UsageError if it is of another kind or size."""
    model = onnx.load_from_string(bundle.onnx)
    found = {each.name: numpy_helper.to_array(each) for each in model.graph.initializer}
    hooks = []
    for name, module in net.named_modules():
        if isinstance(module, nn.Sequential) and len(module) > 1 and isinstance(module[1], _NORMS):
            layer: Any = module[0]
            norm: Any = module[1]
            _take(bundle, layer.weight, found.get(f"{name}.0.weight"), f"{name}.0.weight")
            bias = torch.empty_like(norm.bias)
            _take(bundle, bias, found.get(f"{name}.0.weight_bias"), f"{name}.0.weight_bias")
            hooks.append(norm.register_forward_pre_hook(_opened(bias)))
        elif isinstance(module, nn.Linear):
            for part in ("weight", "bias"):
                own = getattr(module, part)
                _take(bundle, own, found.get(f"{name}.{part}"), f"{name}.{part}")
    net.eval()
    with torch.no_grad():
        net(*windows)
    for hook in hooks:
        hook.remove()


def _take(bundle: Bundle, own: torch.Tensor, values: NDArray[Any] | None, name: str) -> None:
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
