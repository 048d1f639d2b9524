"""A temporal head in the ONNX graph of a bundle, beside the network's last layer.

The network takes `hidden` besides, and gives `fused_logits` and `next_hidden`; what it says of
single windows stays as it is, bit by bit::

    projected    = relu(given A' + a')
    next_hidden  = GRU(projected, hidden)
    fused_logits = (next_hidden B' + b) / temperature
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper
from onnx.onnx_ml_pb2 import TensorProto

from radard.errors import UsageError
from radard.judge.classifier import FUSED_LOGITS, HIDDEN, NEXT_HIDDEN
from x2train.nets.temporal_head import HeadTrained

_P = "temporal_"
GIVEN = f"{_P}given"


def with_given(onnx_bytes: bytes) -> bytes:
    """Return the network with what its last layer is given as an output, `GIVEN`.

    Raises UsageError if it does not end in a linear layer, or has a temporal head already.
    """
    model = onnx.load_from_string(onnx_bytes)
    _check(model)
    name = _given_to_last(model)
    model.graph.node.append(helper.make_node("Identity", [name], [GIVEN]))
    model.graph.output.append(helper.make_tensor_value_info(GIVEN, TensorProto.FLOAT, None))
    return bytes(model.SerializeToString())


def with_head(onnx_bytes: bytes, trained: HeadTrained) -> bytes:
    """Return a bundle's network with a temporal head; raises UsageError as `with_given`.

    What standardises is taken into the projection, the temperature into the last layer.
    """
    model = onnx.load_from_string(onnx_bytes)
    _check(model)
    graph = model.graph
    given, values = _given_to_last(model), _values(trained)
    for name, array in values.items():
        graph.initializer.append(numpy_helper.from_array(array, _P + name))
    n_hidden = values["recurrence"].shape[2]
    steps: tuple[tuple[str, list[str], list[str], Mapping[str, Any]], ...] = (
        ("Gemm", [given, _P + "projection", _P + "offset"], [_P + "projected"], {}),
        ("Relu", [_P + "projected"], [_P + "rectified"], {}),
        ("Unsqueeze", [_P + "rectified", _P + "axis"], [_P + "step"], {}),
        ("Unsqueeze", [HIDDEN, _P + "axis"], [_P + "before"], {}),
        (
            "GRU",
            [_P + "step", _P + "weight", _P + "recurrence", _P + "bias", "", _P + "before"],
            ["", _P + "after"],
            {"hidden_size": n_hidden, "linear_before_reset": 1},
        ),
        ("Squeeze", [_P + "after", _P + "axis"], [NEXT_HIDDEN], {}),
        ("Gemm", [NEXT_HIDDEN, _P + "out", _P + "out_bias"], [FUSED_LOGITS], {}),
    )
    graph.node.extend(
        [helper.make_node(op, takes, gives, **options) for op, takes, gives, options in steps]
    )
    batch = graph.input[0].type.tensor_type.shape.dim[0].dim_param
    for name, n, to in (
        (HIDDEN, n_hidden, graph.input),
        (FUSED_LOGITS, values["out"].shape[1], graph.output),
        (NEXT_HIDDEN, n_hidden, graph.output),
    ):
        to.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, [batch, n]))
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))


def n_parameters(onnx_bytes: bytes) -> int:
    """Return how many numbers a network has learned."""
    graph = onnx.load_from_string(onnx_bytes).graph
    arrays = [numpy_helper.to_array(each) for each in graph.initializer]
    return sum(a.size for a in arrays if a.dtype == np.float32 and a.size > 1)


def _check(model: onnx.ModelProto) -> None:
    if HIDDEN in {each.name for each in model.graph.input}:
        msg = "the bundle has a temporal head already; take the one that it was made from"
        raise UsageError(msg)


def _given_to_last(model: onnx.ModelProto) -> str:
    """Return the name of what the layer before the logits is given."""
    by_output = {name: node for node in model.graph.node for name in node.output}
    constants = {each.name for each in model.graph.initializer}
    node = by_output.get(model.graph.output[0].name)
    if node is not None and node.op_type == "Add":
        node = next((by_output[name] for name in node.input if name in by_output), None)
    if node is None or node.op_type not in {"Gemm", "MatMul"} or node.input[1] not in constants:
        msg = "the bundle's network does not end in a linear layer; a temporal head needs one"
        raise UsageError(msg)
    return str(node.input[0])


def _values(trained: HeadTrained) -> dict[str, NDArray[Any]]:
    """Return the weights as ONNX wants them: in double precision until the last moment."""
    head = trained.head
    state = {key: v.detach().numpy().astype(np.float64) for key, v in head.state_dict().items()}
    projection = state["projection.weight"] / state["spread"]
    n_hidden = head.gru.hidden_size
    # torch: reset, update, new; ONNX: update, reset, new.
    order = np.concatenate([np.arange(n_hidden) + k * n_hidden for k in (1, 0, 2)])
    biases = [state["gru.bias_ih_l0"][order], state["gru.bias_hh_l0"][order]]
    values = {
        "projection": projection.T,
        "offset": state["projection.bias"] - projection @ state["mean"],
        "weight": state["gru.weight_ih_l0"][order][None],
        "recurrence": state["gru.weight_hh_l0"][order][None],
        "bias": np.concatenate(biases)[None],
        "out": state["out.weight"].T / trained.temperature,
        "out_bias": state["out.bias"] / trained.temperature,
    }
    made = {key: np.ascontiguousarray(value, np.float32) for key, value in values.items()}
    return {**made, "axis": np.array([0])}
