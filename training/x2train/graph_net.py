"""A bundle's ONNX graph as a torch network, so that it can be trained on.

Bundles carry no torch weights, and need none: their graphs are chains of a few operators. What
is learned goes back into the same graph, so inputs, outputs and shape of the network stay.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper
from torch import nn
from torch.nn import functional

from radard.errors import UsageError

Tensor = torch.Tensor
Operator = Callable[[list[Any], Mapping[str, Any]], Tensor]


class GraphNet(nn.Module):
    """The network of a bundle.

    Parameters
    ----------
    onnx_bytes : bytes
        From the bundle.

    Raises
    ------
    UsageError
        If it has an operator that is not known here.
    """

    def __init__(self, onnx_bytes: bytes) -> None:
        super().__init__()
        self._model = onnx.load_from_string(onnx_bytes)
        graph = self._model.graph
        unknown = sorted({n.op_type for n in graph.node} - set(_OPERATORS))
        if unknown:
            msg = f"the bundle's network has {', '.join(unknown)}, which cannot be trained on here"
            raise UsageError(msg)
        self._inputs = [each.name for each in graph.input]
        self._constants: dict[str, Any] = {}
        self._names: dict[str, str] = {}
        for each in graph.initializer:
            values = numpy_helper.to_array(each).copy()
            if values.dtype == np.float32 and values.size > 1:
                own = f"p{len(self._names)}"
                self._names[each.name] = own
                self.register_parameter(own, nn.Parameter(torch.from_numpy(values)))
            else:
                self._constants[each.name] = values

    def forward(self, *inputs: Tensor) -> Tensor:
        """Return the logits, shape (n, n_classes)."""
        known: dict[str, Any] = dict(self._constants)
        known.update({name: getattr(self, own) for name, own in self._names.items()})
        known.update(zip(self._inputs, inputs, strict=True))
        for node in self._model.graph.node:
            options = {a.name: helper.get_attribute_value(a) for a in node.attribute}
            given = [known[name] if name else None for name in node.input]
            known[node.output[0]] = _OPERATORS[node.op_type](given, options)
        logits: Tensor = known[self._model.graph.output[0].name]
        return logits

    def to_onnx(self) -> bytes:
        """Return the graph with the weights of now."""
        for each in self._model.graph.initializer:
            if each.name in self._names:
                values = getattr(self, self._names[each.name]).detach().numpy()
                each.CopyFrom(numpy_helper.from_array(values, each.name))
        onnx.checker.check_model(self._model)
        return bytes(self._model.SerializeToString(deterministic=True))


def _conv(given: list[Any], options: Mapping[str, Any]) -> Tensor:
    x, weight, bias = (*given, None)[:3]
    n = weight.ndim - 2
    pads = list(options.get("pads", [0] * 2 * n))
    if pads[:n] != pads[n:]:
        # torch wants the last axis first, begin and end of each.
        flat = [p for k in reversed(range(n)) for p in (pads[k], pads[n + k])]
        x, pads = functional.pad(x, flat), [0] * 2 * n
    made: Tensor = (functional.conv1d if n == 1 else functional.conv2d)(
        x,
        weight,
        bias,
        stride=tuple(options.get("strides", [1] * n)),
        padding=tuple(pads[:n]),
        dilation=tuple(options.get("dilations", [1] * n)),
        groups=options.get("group", 1),
    )
    return made


def _gemm(given: list[Any], options: Mapping[str, Any]) -> Tensor:
    a, b = (
        each.T if options.get(key) else each
        for each, key in zip(given, ("transA", "transB"), strict=False)
    )
    made: Tensor = options.get("alpha", 1.0) * (a @ b)
    return made + options.get("beta", 1.0) * given[2] if len(given) > 2 else made


def _reshape(given: list[Any], _options: Mapping[str, Any]) -> Tensor:
    x, shape = given[0], [int(n) for n in given[1]]
    made: Tensor = x.reshape([x.shape[k] if n == 0 else n for k, n in enumerate(shape)])
    return made


def _unsqueeze(given: list[Any], _options: Mapping[str, Any]) -> Tensor:
    x: Tensor = given[0]
    for axis in sorted(int(n) for n in given[1]):
        x = x.unsqueeze(axis)
    return x


def _reduced(reduce: Callable[..., Tensor]) -> Operator:
    def run(given: list[Any], options: Mapping[str, Any]) -> Tensor:
        axes = tuple(int(n) for n in given[1])
        return reduce(given[0], dim=axes, keepdim=bool(options.get("keepdims", 1)))

    return run


_OPERATORS: Mapping[str, Operator] = {
    "Add": lambda given, _: given[0] + given[1],
    "Concat": lambda given, options: torch.cat(given, dim=options["axis"]),
    "Conv": _conv,
    "Flatten": lambda given, options: given[0].flatten(options.get("axis", 1)),
    "Gemm": _gemm,
    "MatMul": lambda given, _: given[0] @ given[1],
    "Mul": lambda given, _: given[0] * given[1],
    "ReduceMax": _reduced(torch.amax),
    "ReduceMean": _reduced(torch.mean),
    "Relu": lambda given, _: torch.relu(given[0]),
    "Reshape": _reshape,
    "Sigmoid": lambda given, _: torch.sigmoid(given[0]),
    "Unsqueeze": _unsqueeze,
}
