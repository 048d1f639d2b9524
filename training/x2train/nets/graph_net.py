"""A bundle's ONNX graph as a torch network, so that it can be trained on.

Bundles carry no torch weights, and need none: their graphs are chains of a few operators. What
is learned goes back into the same graph, so inputs, outputs and shape of the network stay.
"""

from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any

import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper
from torch import nn
from torch.nn import functional

from radard.errors import UsageError
from radard.judge.classifier import FUSED_LOGITS

Tensor = torch.Tensor
_Operator = Callable[[list[Any], Mapping[str, Any]], Tensor]


class GraphNet(nn.Module):
    """The network of a bundle; raises UsageError if it has an operator that is not known here."""

    def __init__(self, onnx_bytes: bytes) -> None:
        super().__init__()
        self._model = onnx.load_from_string(onnx_bytes)
        graph = self._model.graph
        heads = [FUSED_LOGITS] if FUSED_LOGITS in {each.name for each in graph.output} else []
        self._outputs = [graph.output[0].name, *heads]
        wanted, nodes = set(self._outputs), []
        for node in reversed(graph.node):
            if wanted & set(node.output):
                nodes.append(node)
                wanted |= set(node.input)
        self._nodes = nodes[::-1]
        unknown = sorted({n.op_type for n in self._nodes} - set(_OPERATORS))
        if unknown:
            msg = f"the bundle's network has {', '.join(unknown)}, which cannot be trained on here"
            raise UsageError(msg)
        used = {name for node in self._nodes for name in node.input}
        self._inputs = [each.name for each in graph.input]
        self._constants: dict[str, Any] = {}
        self._names: dict[str, str] = {}
        for each in graph.initializer:
            if each.name not in used:
                continue
            values = numpy_helper.to_array(each).copy()
            if values.dtype == np.float32 and values.size > 1:
                own = f"p{len(self._names)}"
                self._names[each.name] = own
                self.register_parameter(own, nn.Parameter(torch.from_numpy(values)))
            else:
                self._constants[each.name] = torch.from_numpy(values)

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        """Return the logits, shape (n, n_classes), and those of a temporal head, if it has one."""
        known: dict[str, Any] = dict(self._constants)
        known.update({name: getattr(self, own) for name, own in self._names.items()})
        known.update(zip(self._inputs, inputs, strict=True))
        for node in self._nodes:
            options = {a.name: helper.get_attribute_value(a) for a in node.attribute}
            given = [known[name] if name else None for name in node.input]
            # A GRU's first output, all steps, is not asked for; there is but one.
            at = 0 if node.output[0] else 1
            known[node.output[at]] = _OPERATORS[node.op_type](given, options)
        return tuple(known[name] for name in self._outputs)

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


def _gru(given: list[Any], _options: Mapping[str, Any]) -> Tensor:
    """Return the hidden values after one step; ONNX has update, reset, new."""
    x, weight, recurrence, bias, _, hidden = given
    ours = functional.linear(x[0], weight[0], bias[0].chunk(2)[0]).chunk(3, dim=1)
    theirs = functional.linear(hidden[0], recurrence[0], bias[0].chunk(2)[1]).chunk(3, dim=1)
    update, reset = (torch.sigmoid(a + b) for a, b in zip(ours[:2], theirs[:2], strict=True))
    new = torch.tanh(ours[2] + reset * theirs[2])
    made: Tensor = (1 - update) * new + update * hidden[0]
    return made[None]


def _reshape(given: list[Any], _options: Mapping[str, Any]) -> Tensor:
    x, shape = given[0], [int(n) for n in given[1]]
    made: Tensor = x.reshape([x.shape[k] if n == 0 else n for k, n in enumerate(shape)])
    return made


def _reduced(over: Callable[..., Tensor]) -> _Operator:
    def run(given: list[Any], options: Mapping[str, Any]) -> Tensor:
        axes = tuple(int(n) for n in given[1])
        return over(given[0], dim=axes, keepdim=bool(options.get("keepdims", 1)))

    return run


_OPERATORS: Mapping[str, _Operator] = {
    "Add": lambda given, _: given[0] + given[1],
    "Concat": lambda given, options: torch.cat(given, dim=options["axis"]),
    "Conv": _conv,
    "Flatten": lambda given, options: given[0].flatten(options.get("axis", 1)),
    "GRU": _gru,
    "Gemm": _gemm,
    "LogSoftmax": lambda given, options: functional.log_softmax(given[0], options.get("axis", -1)),
    "MatMul": lambda given, _: given[0] @ given[1],
    "Mul": lambda given, _: given[0] * given[1],
    "ReduceMax": _reduced(torch.amax),
    "ReduceMean": _reduced(torch.mean),
    "Relu": lambda given, _: torch.relu(given[0]),
    "Reshape": _reshape,
    "Squeeze": lambda given, _: given[0].squeeze(tuple(given[1].tolist())),
    "Sigmoid": lambda given, _: torch.sigmoid(given[0]),
    "Tanh": lambda given, _: torch.tanh(given[0]),
    "Unsqueeze": lambda given, _: reduce(torch.unsqueeze, sorted(given[1].tolist()), given[0]),
}
