"""The ONNX graph of a bundle: what its layers see, and a verifier put beside its last one.

What is seen of a window is what the last layer is given, and of every ReLU before it, row by
row, mean and standard deviation over time: 4,500 numbers of the bundle `balanced`. The last
layer alone has forgotten what makes one pet unlike another.

The verifier's part of the graph::

    score = w . seen + b
    logits = plain logits + clip(slope (score - threshold), 0, most) temperature e_pet

and with a temporal head, whose hidden values have `recent` and `count` at their end::

    count' = min(count + 1, memory)
    recent' = recent + (score - recent) / count'
    fused logits = plain fused logits + clip(slope (recent' - fused threshold), 0, most) e_pet

Where a score is under its threshold the logits are those of the network, bit by bit,
and nothing ever raises a person's probability: an alarm may become a pet, no more.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

from radard.classify.classifier import FUSED_LOGITS, HIDDEN, NEXT_HIDDEN
from radard.errors import UsageError

SEEN = "verifier_seen"
PLAIN, PLAIN_FUSED = "verifier_plain_logits", "verifier_plain_fused_logits"
_PLAIN_HIDDEN, _PLAIN_NEXT = "verifier_plain_hidden", "verifier_plain_next_hidden"
_Step: TypeAlias = tuple[str, list[str], list[str]]
"""Of a graph: what is done, with what, and what comes of it."""
SLOPE = 4.0
"""Nats of evidence for each nat of score over the threshold: steep, but without a jump."""
MOST_NATS = 6.0
"""Most that is added: where the network is surer of a person than that, the alarm stays."""
MEMORY = 4
"""Windows whose scores count for the fused logits: somebody who comes after the pet is no pet."""
N_KEPT = 2
"""Hidden values of a verifier."""
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
        Score above which the logits of a window turn towards pet.
    fused_threshold : float
        Recent score above which those of a temporal head do; infinite: never.
    """

    weight: NDArray[np.float64]
    bias: float
    threshold: float
    fused_threshold: float = float("inf")

    def score(self, seen: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the scores of windows, shape (n,), of what is seen, shape (n, n_seen)."""
        return np.asarray(seen @ self.weight + self.bias, np.float64)

    def excess(self, score: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what is added to the log-likelihood of a pet, in nats, by scores of windows."""
        return _clipped(score - self.threshold)

    def fused_excess(self, recent: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what is added to that of the temporal head, in nats, by recent scores."""
        return _clipped(recent - self.fused_threshold)


def recent_scores(score: NDArray[np.float64], is_first: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the running mean of the scores of windows in order, shape (n,).

    Parameters
    ----------
    score : ndarray, shape (n,), float64
    is_first : ndarray, shape (n,), bool
        Where the gate has opened: there it begins anew.
    """
    found = np.zeros(len(score))
    recent, count = 0.0, 0
    for k, (value, is_new) in enumerate(zip(score.tolist(), is_first.tolist(), strict=True)):
        recent, count = (0.0, 0) if is_new else (recent, count)
        count = min(count + 1, MEMORY)
        recent += (value - recent) / count
        found[k] = recent
    return found


def _clipped(over: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.clip(SLOPE * over, 0.0, MOST_NATS)


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
    """Return the network with a verifier beside it; of a temporal head `N_KEPT` more are hidden.

    Parameters
    ----------
    onnx_bytes : bytes
        A bundle's network, without a verifier.
    head : Head
        With its thresholds.
    pet : int
        Which of the logits is that of a pet.
    temperature : float
        Logits are divided by it later.
    """
    model = with_seen(onnx_bytes)
    graph = model.graph
    has_head = FUSED_LOGITS in {each.name for each in graph.output}
    plain = {graph.output[0].name: PLAIN}
    if has_head:
        plain |= {FUSED_LOGITS: PLAIN_FUSED, NEXT_HIDDEN: _PLAIN_NEXT, HIDDEN: _PLAIN_HIDDEN}
    for node in graph.node:
        for names in (node.input, node.output):
            names[:] = [plain.get(name, name) for name in names]
    n_classes = graph.output[0].type.tensor_type.shape.dim[-1].dim_value
    turn = np.zeros((1, n_classes))
    turn[0, pet] = 1
    constants = {
        "weight": head.weight[:, None],
        "bias": np.array([head.bias]),
        "slope": np.array(SLOPE),
        "none": np.array(0.0),
        "most": np.array(MOST_NATS),
        "threshold": np.array(head.threshold),
        "turn": temperature * turn,
    }
    steps: list[_Step] = [("Gemm", [SEEN, "weight", "bias"], ["score"])]
    steps += _turning("score", "threshold", "turn", PLAIN, graph.output[0].name)
    if has_head:
        # The temporal head's answers are calibrated as they are.
        constants |= {
            "fused_threshold": np.array(head.fused_threshold),
            "fused_turn": turn,
            "one": np.array(1.0),
            "memory": np.array(float(MEMORY)),
        }
        (given,) = (each for each in graph.input if each.name == HIDDEN)
        n_hidden = given.type.tensor_type.shape.dim[1].dim_value
        sizes = numpy_helper.from_array(np.array([n_hidden, 1, 1]), "verifier_sizes")
        graph.initializer.append(sizes)
        kept = [_PLAIN_HIDDEN, "verifier_recent", "verifier_count"]
        # First of all nodes: the head needs its share of what was kept.
        split = helper.make_node("Split", [HIDDEN, "verifier_sizes"], kept, axis=1)
        graph.node.insert(0, split)
        steps += [
            ("Add", ["count", "one"], ["counted"]),
            ("Min", ["counted", "memory"], ["next_count"]),
            ("Sub", ["score", "recent"], ["newer"]),
            ("Div", ["newer", "next_count"], ["step"]),
            ("Add", ["recent", "step"], ["next_recent"]),
            *_turning("next_recent", "fused_threshold", "fused_turn", PLAIN_FUSED, FUSED_LOGITS),
        ]
        (handed,) = (each for each in graph.output if each.name == NEXT_HIDDEN)
        for each in (given, handed):
            each.type.tensor_type.shape.dim[1].dim_value = n_hidden + N_KEPT
    for name, values in constants.items():
        array = np.asarray(values, np.float32)
        graph.initializer.append(numpy_helper.from_array(array, f"verifier_{name}"))
    outside = {SEEN, FUSED_LOGITS, graph.output[0].name, *plain.values()}
    for op, given_names, made in steps:
        takes, gives = (
            [name if name in outside else f"verifier_{name}" for name in names]
            for names in (given_names, made)
        )
        graph.node.append(helper.make_node(op, takes, gives))
    if has_head:
        parts = [_PLAIN_NEXT, "verifier_next_recent", "verifier_next_count"]
        graph.node.append(helper.make_node("Concat", parts, [NEXT_HIDDEN], axis=1))
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))


def _turning(score: str, threshold: str, turn: str, plain: str, made: str) -> list[_Step]:
    """Return the steps from a score to logits that it turns."""
    return [
        ("Sub", [score, threshold], [f"{score}_over"]),
        ("Mul", [f"{score}_over", "slope"], [f"{score}_nats"]),
        ("Clip", [f"{score}_nats", "none", "most"], [f"{score}_excess"]),
        ("MatMul", [f"{score}_excess", turn], [f"{score}_turned"]),
        ("Add", [plain, f"{score}_turned"], [made]),
    ]


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
