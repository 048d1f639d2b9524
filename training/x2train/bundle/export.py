"""Graphs of bundles: from torch to ONNX, several networks as one, and a temporal head beside one.

Networks that were trained apart err apart (Hansen and Salamon, 1990, recalled); joined, they give
the mean of what they say, each calibrated by itself. All end in a linear layer, and so does the
mean: logits = (1 / n) sum_k (given_k W_k' + b_k) / temperature_k.

With a head the network takes `hidden` besides, and gives `fused_logits` and `next_hidden`; what it
says of single windows stays as it is, bit by bit::

    given        = relu(given A' + a'), for a network that is heard apart of its own values alone
    said         = tanh(log_softmax(logits / temperature of windows) A' + a')
    next_hidden  = GRU([given, said], hidden)
    fused_logits = (next_hidden B' + b) / temperature

All parts of a head are one GRU, whose weights from one to another are zero.
"""

import inspect
import logging
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from operator import attrgetter
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import compose, helper, numpy_helper
from onnx.onnx_ml_pb2 import TensorProto
from scipy.linalg import block_diag

from radard.errors import RadardError, UsageError
from radard.judge.bundle import Bundle, ModelInput
from radard.judge.classifier import FUSED_LOGITS, HIDDEN, NEXT_HIDDEN
from radard.judge.onnx_runtime import ort
from x2train.nets.calibration import Trained
from x2train.nets.temporal_head import N_CLASSES, HeadSettings, TemporalHead

Array = NDArray[np.float64]
_MAX_DIFFERENCE = 1e-4  # of any logit, which are some tens, in single precision
DIFFERENCE = "logit difference torch - onnxruntime"  # the metric that says how far apart they are
_P = "temporal_"
_Step = tuple[str, str, str, Mapping[str, Any]]  # operator, inputs, outputs, options
GIVEN = f"{_P}given"


def exported(
    net: torch.nn.Module, inputs: tuple[ModelInput, ...], sample: Mapping[str, NDArray[Any]]
) -> tuple[bytes, float]:
    """Return the network as ONNX, and its difference from torch; RadardError if that is large."""
    x = {
        each.name: np.asarray(v / 255 if v.dtype == np.uint8 else v, np.float32)
        for each in inputs
        for v in (sample[each.name],)
    }
    onnx_bytes = to_onnx(net, inputs)
    session = ort.InferenceSession(onnx_bytes, providers=["CPUExecutionProvider"])
    ours = session.run(None, x)[0]
    with torch.no_grad():
        theirs = net(*(torch.from_numpy(each) for each in x.values())).numpy()
    return onnx_bytes, checked(float(np.abs(np.asarray(ours) - theirs).max()))


def checked(difference: float) -> float:
    """Return how far onnxruntime is from torch, to two digits; raise RadardError if too far."""
    if not difference <= _MAX_DIFFERENCE:
        msg = f"torch and onnxruntime differ by {difference:.2g} (at most {_MAX_DIFFERENCE:g})"
        raise RadardError(msg)
    return float(f"{difference:.1e}")


def to_onnx(net: torch.nn.Module, inputs: tuple[ModelInput, ...]) -> bytes:
    """Return the network as ONNX with a free batch size, without traces of this machine."""
    net.eval()
    example = tuple(torch.zeros(2, *each.shape) for each in inputs)
    batch = torch.export.Dim("batch")
    free: Any = tuple({0: batch} for _ in inputs)
    parameters = inspect.signature(net.forward).parameters.values()
    if any(p.kind is p.VAR_POSITIONAL for p in parameters):
        # A network with *args has one argument, which is a tuple.
        free = (free,)
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            net,
            example,
            dynamo=True,
            external_data=False,
            verbose=False,
            input_names=[each.name for each in inputs],
            output_names=["logits"],
            dynamic_shapes=free,
        )
    assert program is not None  # noqa: S101 - dynamo=True returns a program
    model = program.model_proto
    # The exporter notes source files and stack traces; the bundle must not carry them.
    del model.metadata_props[:]
    del model.graph.metadata_props[:]
    model.doc_string = model.graph.doc_string = ""
    graph = model.graph
    parts = (graph.node, graph.value_info, graph.input, graph.output, graph.initializer)
    for item in (each for part in parts for each in part):
        item.doc_string = ""
        if hasattr(item, "metadata_props"):
            del item.metadata_props[:]
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))


def joined(bundles: Sequence[Bundle]) -> Bundle:
    """Return a bundle that says the mean of several; UsageError if they do not fit."""
    first = bundles[0]
    if len(bundles) == 1:
        return first
    taken = attrgetter("inputs", "features", "classes")
    for each in bundles[1:]:
        if taken(each) != taken(first):
            raise UsageError(f"models '{first.name}' and '{each.name}' do not take the same maps")
    graph = onnx.GraphProto(name="joined")
    givens, weights, biases = [], [], []
    models = [onnx.load_from_string(bundle.onnx) for bundle in bundles]
    for k, (bundle, model) in enumerate(zip(bundles, models, strict=True)):
        check_headless(model)
        layer = last_layer(model)
        given, *names = layer.input
        if len(names) != 2:
            msg = f"model '{bundle.name}': its last layer has no bias; it cannot be joined"
            raise UsageError(msg)
        values = {each.name: numpy_helper.to_array(each) for each in model.graph.initializer}
        share = 1.0 / (len(bundles) * bundle.temperature)
        weight, bias = (share * values[name].astype(np.float64) for name in names)
        givens.append(f"{k}_{given}")
        weights.append(weight)
        biases.append(bias)
        model.graph.node.remove(layer)
        # Else inputs that it names get the prefix as well.
        del model.graph.value_info[:]
        part = compose.add_prefix(model, f"{k}_", rename_inputs=False).graph
        used = {f"{k}_{name}" for name in names}
        graph.node.extend(part.node)
        graph.initializer.extend(each for each in part.initializer if each.name not in used)
        graph.input.extend(part.input if k == 0 else ())
    whole_weight = np.concatenate(weights, axis=1, dtype=np.float32)
    whole_bias = np.sum(biases, axis=0).astype(np.float32)
    inputs = ["joined_given", "joined_weight", "joined_bias"]
    for array, name in zip((whole_weight, whole_bias), inputs[1:], strict=True):
        graph.initializer.append(numpy_helper.from_array(array, name))
    graph.node.append(helper.make_node("Concat", givens, inputs[:1], axis=1))
    graph.node.append(helper.make_node("Gemm", inputs, ["logits"], transB=1))
    batch = graph.input[0].type.tensor_type.shape.dim[0].dim_param
    shape = [batch, len(biases[0])]
    graph.output.append(helper.make_tensor_value_info("logits", TensorProto.FLOAT, shape))
    whole = helper.make_model(
        graph, opset_imports=models[0].opset_import, ir_version=models[0].ir_version
    )
    onnx.checker.check_model(whole)
    return replace(first, onnx=whole.SerializeToString(deterministic=True), temperature=1.0)


def with_given(onnx_bytes: bytes) -> bytes:
    """Return the network with its last layer's input as output `GIVEN`; or UsageError."""
    model = onnx.load_from_string(onnx_bytes)
    check_headless(model)
    name = last_layer(model).input[0]
    model.graph.node.append(helper.make_node("Identity", [name], [GIVEN]))
    model.graph.output.append(helper.make_tensor_value_info(GIVEN, TensorProto.FLOAT, None))
    return bytes(model.SerializeToString())


def with_head(onnx_bytes: bytes, trained: Trained[TemporalHead], temperature: float) -> bytes:
    """Return a bundle's network with a temporal head; raises UsageError as `with_given`."""
    model = onnx.load_from_string(onnx_bytes)
    check_headless(model)
    graph = model.graph
    given, values = last_layer(model).input[0], _values(trained, temperature)
    for name, array in values.items():
        graph.initializer.append(numpy_helper.from_array(array, _P + name))
    n_hidden = values["recurrence"].shape[2]
    # What is not the head's own, which has the prefix; none is an input or output left out.
    names = {name: name for name in (HIDDEN, NEXT_HIDDEN, FUSED_LOGITS)}
    names |= {"given": given, "logits": graph.output[0].name, "none": ""}
    said: tuple[_Step, ...] = (
        ("Mul", "logits scale", "scaled", {}),
        ("LogSoftmax", "scaled", "log_p", {"axis": 1}),
        ("Gemm", "log_p said_projection said_offset", "said", {}),
        ("Tanh", "said", "from_said", {}),
        ("Concat", "from_given from_said", "both", {"axis": 1}),
    )
    has_said = "said_projection" in values
    steps: tuple[_Step, ...] = (
        ("Gemm", "given given_projection given_offset", "projected", {}),
        ("Relu", "projected", "from_given", {}),
        *(said if has_said else ()),
        ("Unsqueeze", f"{'both' if has_said else 'from_given'} axis", "step", {}),
        ("Unsqueeze", f"{HIDDEN} axis", "before", {}),
        (
            *("GRU", "step weight recurrence bias none before", "none after"),
            {"hidden_size": n_hidden, "linear_before_reset": 1},
        ),
        ("Squeeze", "after axis", NEXT_HIDDEN, {}),
        ("Gemm", f"{NEXT_HIDDEN} out out_bias", FUSED_LOGITS, {}),
    )
    for operator, takes, gives, options in steps:
        inputs = [names.get(word, _P + word) for word in takes.split()]
        outputs = [names.get(word, _P + word) for word in gives.split()]
        graph.node.append(helper.make_node(operator, inputs, outputs, **options))
    batch = graph.input[0].type.tensor_type.shape.dim[0].dim_param
    for name, n, to in (
        (HIDDEN, n_hidden, graph.input),
        (FUSED_LOGITS, values["out"].shape[1], graph.output),
        (NEXT_HIDDEN, n_hidden, graph.output),
    ):
        to.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, [batch, n]))
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))


def last_layer(model: onnx.ModelProto) -> onnx.NodeProto:
    """Return the linear layer before the logits; UsageError if there is none."""
    by_output = {name: node for node in model.graph.node for name in node.output}
    constants = {each.name for each in model.graph.initializer}
    node = by_output.get(model.graph.output[0].name)
    if node is not None and node.op_type == "Add":
        node = next((by_output[name] for name in node.input if name in by_output), None)
    if node is None or node.op_type not in {"Gemm", "MatMul"} or node.input[1] not in constants:
        msg = "the bundle's network does not end in a linear layer; a temporal head needs one"
        raise UsageError(msg)
    layer: onnx.NodeProto = node
    return layer


def spans_of(networks: Sequence[bytes]) -> list[tuple[int, int]]:
    """Return which values of what a mean's head is given are each network's; or UsageError."""
    ends = [0]
    for onnx_bytes in networks:
        model = onnx.load_from_string(onnx_bytes)
        weight = last_layer(model).input[1]
        shape = next(tuple(i.dims) for i in model.graph.initializer if i.name == weight)
        # A Gemm has its weights as torch has them, a MatMul the other way round.
        ends.append(ends[-1] + max(shape))
    return list(pairwise(ends))


def n_parameters(onnx_bytes: bytes) -> int:
    """Return how many numbers a network has learned."""
    graph = onnx.load_from_string(onnx_bytes).graph
    arrays = [numpy_helper.to_array(each) for each in graph.initializer]
    return sum(int(np.count_nonzero(a)) for a in arrays if a.dtype == np.float32 and a.size > 1)


def check_headless(model: onnx.ModelProto) -> None:
    """Raise UsageError if a network has a temporal head."""
    if HIDDEN in {each.name for each in model.graph.input}:
        msg = "the bundle has a temporal head already; take the one that it was made from"
        raise UsageError(msg)


def head_of(onnx_bytes: bytes, settings: HeadSettings, n_given: int) -> dict[str, Array]:
    """Return the weights of a network's head, its temperature in them.

    They go with any network whose last layer is given `n_given` values, of which the last are
    this one's. Raises UsageError if it has no head, one of more values or of another size.
    """
    graph = onnx.load_from_string(onnx_bytes).graph
    found = {
        each.name.removeprefix(_P): numpy_helper.to_array(each).astype(np.float64)
        for each in graph.initializer
        if each.name.startswith(_P)
    }
    n, h, n_said = settings.n_projected, settings.n_hidden, settings.n_said
    sizes = [found[name].shape for name in ("given_projection", "out") if name in found]
    if sizes[1:] != [(h + n_said, N_CLASSES)] or sizes[0][1] != n or sizes[0][0] > n_given:
        msg = "the bundle to go on from has no temporal head of this size and of these networks"
        raise UsageError(msg)
    parts = {"given": (slice(0, n), slice(0, h))}
    if n_said:
        parts["said"] = (slice(n, n + n_said), slice(h, h + n_said))
    biases = np.split(found["bias"][0], 2)
    state: dict[str, Array] = {}
    for part, (taken, hidden) in parts.items():

        def gates(values: Array, part_of: slice = hidden) -> Array:
            update, reset, new = (gate[part_of] for gate in np.split(values, 3))
            return np.concatenate([reset, update, new])

        state |= {
            f"{part}.projection.weight": found[f"{part}_projection"].T,
            f"{part}.projection.bias": found[f"{part}_offset"],
            f"{part}.gru.weight_ih_l0": gates(found["weight"][0])[:, taken],
            f"{part}.gru.weight_hh_l0": gates(found["recurrence"][0])[:, hidden],
            f"{part}.gru.bias_ih_l0": gates(biases[0]),
            f"{part}.gru.bias_hh_l0": gates(biases[1]),
            f"{part}.out.weight": len(parts) * found["out"][hidden].T,
            f"{part}.out.bias": found["out_bias"],
        }
    return state


def _values(trained: Trained[TemporalHead], temperature: float) -> dict[str, NDArray[Any]]:
    """Return the weights as ONNX wants them: in double precision until the last moment."""
    head = trained.net
    state = {key: v.detach().numpy().astype(np.float64) for key, v in head.state_dict().items()}
    shares = head.settings.shares
    parts = sorted(shares, key=lambda part: part == "said")  # which comes last
    n_given = len(state["mean"])
    rows, offsets = [], []
    for part, (first, end) in zip(parts, [(0, n_given), *head.settings.apart], strict=False):
        row = np.zeros((head.settings.n_projected, n_given))
        row[:, first:end] = state[f"{part}.projection.weight"] / state["spread"][first:end]
        rows.append(row)
        offsets.append(state[f"{part}.projection.bias"])
    projection = np.concatenate(rows)

    def joined(weights: str) -> NDArray[np.float64]:
        """Return the parts' weights of a GRU, one gate after the other, zero between them."""
        of_parts = [np.split(state[f"{part}.gru.{weights}_l0"], 3) for part in parts]
        # torch: reset, update, new; ONNX: update, reset, new.
        gates = [[each[k] for each in of_parts] for k in (1, 0, 2)]
        join = np.concatenate if gates[0][0].ndim == 1 else lambda gate: block_diag(*gate)
        return np.concatenate([join(gate) for gate in gates])

    share = {part: shares[part] / trained.temperature for part in parts}
    values = {
        "given_projection": projection.T,
        "given_offset": np.concatenate(offsets) - projection @ state["mean"],
        "weight": joined("weight_ih")[None],
        "recurrence": joined("weight_hh")[None],
        "bias": np.concatenate([joined("bias_ih"), joined("bias_hh")])[None],
        "out": np.hstack([share[part] * state[f"{part}.out.weight"] for part in parts]).T,
        "out_bias": np.sum([share[part] * state[f"{part}.out.bias"] for part in parts], axis=0),
    }
    if "said" in parts:
        values |= {
            "said_projection": state["said.projection.weight"].T,
            "said_offset": state["said.projection.bias"],
            "scale": np.array(1 / temperature),
        }
    made = {
        key: np.array(value, np.float32, order="C", copy=True) for key, value in values.items()
    }
    return {**made, "axis": np.array([0])}
