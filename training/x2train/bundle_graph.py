"""The ONNX graph of a bundle: what its layers see, and a verifier put beside its last one.

What is seen of a window is what the last layer is given, and of every ReLU before it, row by
row, mean and standard deviation over time: 4,500 numbers of the bundle `balanced`. The last
layer alone has forgotten what makes one pet unlike another.

The verifier's part of the graph::

    excess = clip(slope (w . seen + b - threshold), 0, most)
    logits = plain logits + excess temperature e_pet
    fused logits = plain fused logits + excess e_pet      (of a temporal head, if it has one)

Where the head's score is under its threshold the logits are those of the network, bit by bit,
and nothing ever raises a person's probability: an alarm may become a pet, no more.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

from radard.classifier import FUSED_LOGITS
from radard.errors import UsageError

SEEN = "verifier_seen"
PLAIN, PLAIN_FUSED = "verifier_plain_logits", "verifier_plain_fused_logits"
SLOPE = 4.0
"""Nats of evidence for each nat of score over the threshold: steep, but without a jump."""
MOST_NATS = 6.0
"""Most that is added: where the network is surer of a person than that, the alarm stays."""
_LEAST_OPSET = 18
"""From there on axes are an input of ReduceMean."""


@dataclass(frozen=True, slots=True, eq=False)
class Head:
    """A logistic head on what is seen of a window.

    Attributes
    ----------
    weight : ndarray, shape (n_seen,), float64
        Of the score, in nats.
    bias : float
        Likewise.
    threshold : float
        Score above which windows turn towards pet.
    """

    weight: NDArray[np.float64]
    bias: float
    threshold: float

    def score(self, seen: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the scores of windows, shape (n,), of what is seen, shape (n, n_seen)."""
        return np.asarray(seen @ self.weight + self.bias, np.float64)

    def excess(self, seen: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return what is added to the log-likelihood of a pet, in nats, shape (n,)."""
        return np.clip(SLOPE * (self.score(seen) - self.threshold), 0.0, MOST_NATS)


def with_seen(onnx_bytes: bytes) -> onnx.ModelProto:
    """Return the network with nodes that gather what is seen, as `SEEN`, not yet an output.

    Raises
    ------
    UsageError
        If the graph does not end in a linear layer, or has a verifier already.
    """
    model = onnx.load_from_string(onnx_bytes)
    graph = model.graph
    last = given_to_last(model)
    opset = max(each.version for each in model.opset_import if each.domain in {"", "ai.onnx"})
    if opset < _LEAST_OPSET:
        msg = f"the bundle's network is of ONNX opset {opset}; at least {_LEAST_OPSET} is needed"
        raise UsageError(msg)
    inferred = onnx.shape_inference.infer_shapes(model)
    ranks = {v.name: len(v.type.tensor_type.shape.dim) for v in inferred.graph.value_info}
    taps = [
        n.output[0] for n in graph.node if n.op_type == "Relu" and ranks.get(n.output[0], 0) > 2
    ]
    graph.initializer.append(numpy_helper.from_array(np.array([-1]), "verifier_time"))
    parts = [last]
    for k, tap in enumerate(taps):
        parts += [f"verifier_mean_{k}", f"verifier_spread_{k}"]
        graph.node.extend(_statistics(tap, k))
    graph.node.append(helper.make_node("Concat", parts, [SEEN], axis=1))
    return model


def with_verifier(onnx_bytes: bytes, head: Head, *, pet: int, temperature: float) -> bytes:
    """Return the network with a verifier beside it; inputs and outputs stay as they are.

    Parameters
    ----------
    onnx_bytes : bytes
        A bundle's network, without a verifier.
    head : Head
        With its threshold.
    pet : int
        Which of the logits is that of a pet.
    temperature : float
        Logits are divided by it later.
    """
    model = with_seen(onnx_bytes)
    graph = model.graph
    outputs = {graph.output[0].name: PLAIN}
    if FUSED_LOGITS in {each.name for each in graph.output}:
        outputs[FUSED_LOGITS] = PLAIN_FUSED
    for node in graph.node:
        for k, name in enumerate(node.output):
            node.output[k] = outputs.get(name, name)
    n_classes = graph.output[0].type.tensor_type.shape.dim[-1].dim_value
    turn = np.zeros((1, n_classes))
    turn[0, pet] = 1
    plains = outputs.values()
    constants = {
        "weight": (SLOPE * head.weight)[:, None],
        "bias": np.array([SLOPE * (head.bias - head.threshold)]),
        "none": np.array(0.0),
        "most": np.array(MOST_NATS),
        # The head's answers are calibrated as they are.
        **{f"turn_{plain}": turn * (temperature if plain == PLAIN else 1) for plain in plains},
    }
    for name, values in constants.items():
        array = np.asarray(values, np.float32)
        graph.initializer.append(numpy_helper.from_array(array, f"verifier_{name}"))
    steps = [
        ("Gemm", [SEEN, "verifier_weight", "verifier_bias"], "verifier_score"),
        ("Clip", ["verifier_score", "verifier_none", "verifier_most"], "verifier_excess"),
    ]
    for name, plain in outputs.items():
        turned = f"verifier_turned_{plain}"
        steps.append(("MatMul", ["verifier_excess", f"verifier_turn_{plain}"], turned))
        steps.append(("Add", [plain, turned], name))
    graph.node.extend([helper.make_node(op, given, [made]) for op, given, made in steps])
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))


def given_to_last(model: onnx.ModelProto) -> str:
    """Return the name of what the layer before the logits is given.

    Raises
    ------
    UsageError
        If there is no linear layer before them, or a verifier.
    """
    by_output = {name: node for node in model.graph.node for name in node.output}
    if PLAIN in by_output:
        msg = "the bundle has a verifier already; finetune the one that it was made from"
        raise UsageError(msg)
    constants = {each.name for each in model.graph.initializer}
    node = by_output.get(model.graph.output[0].name)
    if node is not None and node.op_type == "Add":
        node = next((by_output[name] for name in node.input if name in by_output), None)
    if node is None or node.op_type not in {"Gemm", "MatMul"} or node.input[1] not in constants:
        msg = "the bundle's network does not end in a linear layer; a verifier needs one"
        raise UsageError(msg)
    return str(node.input[0])


def _statistics(tap: str, k: int) -> Iterator[onnx.NodeProto]:
    """Yield the nodes of mean and standard deviation over the last axis."""
    p = "verifier_"
    steps: tuple[tuple[str, list[str], str, dict[str, Any]], ...] = (
        ("ReduceMean", [tap, p + "time"], f"{p}kept_{k}", {"keepdims": 1}),
        ("Sub", [tap, f"{p}kept_{k}"], f"{p}off_{k}", {}),
        ("Mul", [f"{p}off_{k}", f"{p}off_{k}"], f"{p}square_{k}", {}),
        ("ReduceMean", [f"{p}square_{k}", p + "time"], f"{p}variance_{k}", {"keepdims": 0}),
        ("Sqrt", [f"{p}variance_{k}"], f"{p}root_{k}", {}),
        ("Flatten", [f"{p}root_{k}"], f"{p}spread_{k}", {"axis": 1}),
        ("Flatten", [f"{p}kept_{k}"], f"{p}mean_{k}", {"axis": 1}),
    )
    for op, given, made, options in steps:
        yield helper.make_node(op, given, [made], **options)
