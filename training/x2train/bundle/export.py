"""Export: torch to ONNX, and that onnxruntime computes the same; several networks as one.

Networks that were trained apart err apart (Hansen and Salamon, 1990, recalled); joined, they give
the mean of what they say, each calibrated by itself. All end in a linear layer, and so does the
mean: logits = (1 / n) sum_k (given_k W_k' + b_k) / temperature_k.
"""

import inspect
import logging
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import compose, helper, numpy_helper
from onnx.onnx_ml_pb2 import TensorProto

from radard.errors import RadardError, UsageError
from radard.judge.bundle import Bundle, ModelInput
from radard.judge.onnx_runtime import ort
from x2train.bundle.temporal_graph import check_headless, last_layer

_MAX_DIFFERENCE = 1e-4  # of any logit, which are some tens, in single precision
DIFFERENCE = "logit difference torch - onnxruntime"  # the metric that says how far apart they are


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
