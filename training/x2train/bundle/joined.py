"""Several networks as one: the mean of what they say, each calibrated by itself.

Networks that were trained apart err apart (Hansen and Salamon, 1990, recalled). All end in a
linear layer, and so does the mean: logits = (1 / n) sum_k (given_k W_k' + b_k) / temperature_k.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import compose, helper, numpy_helper
from onnx.onnx_ml_pb2 import TensorProto

from radard.errors import UsageError
from radard.judge.bundle import Bundle
from x2train.bundle.temporal_graph import check_headless, last_layer

Array = NDArray[np.float64]
_GIVEN, _OUT = "joined_given", ("joined_weight", "joined_bias")
_WEIGHT_AND_BIAS = 3  # inputs of a linear layer: what it is given, and these


def joined(bundles: Sequence[Bundle]) -> Bundle:
    """Return a bundle that says the mean of several; UsageError if they do not fit."""
    first = bundles[0]
    if len(bundles) == 1:
        return first
    for each in bundles[1:]:
        if (each.inputs, each.features, each.classes) != (
            first.inputs,
            first.features,
            first.classes,
        ):
            raise UsageError(f"models '{first.name}' and '{each.name}' do not take the same maps")
    return replace(first, onnx=_mean(bundles), temperature=1.0)


def _mean(bundles: Sequence[Bundle]) -> bytes:
    graph = onnx.GraphProto(name="joined")
    givens: list[str] = []
    weights: list[Array] = []
    biases: list[Array] = []
    models = [onnx.load_from_string(bundle.onnx) for bundle in bundles]
    for k, (bundle, model) in enumerate(zip(bundles, models, strict=True)):
        check_headless(model)
        layer = last_layer(model)
        if len(layer.input) != _WEIGHT_AND_BIAS:
            msg = f"model '{bundle.name}': its last layer has no bias; it cannot be joined"
            raise UsageError(msg)
        given, *names = layer.input
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
    graph.initializer.extend(
        (
            numpy_helper.from_array(np.concatenate(weights, axis=1, dtype=np.float32), _OUT[0]),
            numpy_helper.from_array(np.sum(biases, axis=0).astype(np.float32), _OUT[1]),
        )
    )
    graph.node.extend(
        (
            helper.make_node("Concat", givens, [_GIVEN], axis=1),
            helper.make_node("Gemm", [_GIVEN, *_OUT], ["logits"], transB=1),
        )
    )
    batch = graph.input[0].type.tensor_type.shape.dim[0].dim_param
    shape = [batch, len(biases[0])]
    graph.output.append(helper.make_tensor_value_info("logits", TensorProto.FLOAT, shape))
    whole = helper.make_model(
        graph, opset_imports=models[0].opset_import, ir_version=models[0].ir_version
    )
    onnx.checker.check_model(whole)
    return bytes(whole.SerializeToString(deterministic=True))
