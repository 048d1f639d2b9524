"""A bundle whose network is untrained: what a set of features costs, before any training.

The network is a small CNN of the size that the maps need (two branches of three strided
convolutions, some 30 000 weights), drawn from a seed. Its answers mean nothing.
"""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from radard.judge.bundle import CLASSES, SCHEMA
from radard.judge.features import FeatureSettings, feature_shape

_WIDTHS = (16, 24, 40)  # of the three layers: some 30,000 weights
_OPSET = 17  # chosen: any onnxruntime reads it
_IR = 10  # likewise
ANY_STREAM = {
    "frame_rate_hz": (1.0, 1000.0),
    "bin_length_m": (1e-3, 0.1),
    "carrier_hz": (1e9, 1e10),
    "bandwidth_hz": (1e8, 5e9),
}


def write_blank_bundle(
    folder: Path, name: str, settings: FeatureSettings, features: tuple[str, ...], seed: int = 0
) -> Path:
    """Write NAME.onnx and NAME.json."""
    shapes = {feature: feature_shape(feature, settings) for feature in features}
    weights = _network(shapes, np.random.default_rng(seed))
    path = folder / f"{name}.onnx"
    path.write_bytes(weights)
    sidecar = {
        "schema": SCHEMA,
        "name": name,
        "onnx_sha256": hashlib.sha256(weights).hexdigest(),
        "inputs": [{"name": f, "shape": list(s), "feature": f} for f, s in shapes.items()],
        "features": asdict(settings),
        "stream": {key: list(value) for key, value in ANY_STREAM.items()},
        "classes": list(CLASSES),
        "temperature": 1.0,
        "pet_limit": 0.8,
        "policy": "window",
        "training": {"recipe": "none: for measuring time"},
        "metrics": {},
    }
    path.with_suffix(".json").write_text(json.dumps(sidecar, indent=2) + "\n")
    return path


class _Graph:
    """Nodes and weights while they are put together."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.nodes: list[onnx.NodeProto] = []
        self.weights: list[onnx.TensorProto] = []

    def weight(self, name: str, shape: tuple[int, ...]) -> str:
        spread = np.sqrt(2 / np.prod(shape[1:]))
        drawn = self.rng.normal(0.0, spread, shape).astype(np.float32)
        self.weights.append(numpy_helper.from_array(drawn, name))
        return name

    def add(self, kind: str, inputs: list[str], output: str, **attributes: Any) -> str:
        self.nodes.append(helper.make_node(kind, inputs, [output], **attributes))
        return output


def _network(shapes: dict[str, tuple[int, ...]], rng: np.random.Generator) -> bytes:
    graph = _Graph(rng)
    axes = numpy_helper.from_array(np.array([1], np.int64), "channel_axis")
    graph.weights.append(axes)
    parts, n_in, inputs = [], 0, []
    for name, shape in shapes.items():
        inputs.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", *shape]))
        if len(shape) == 1:
            parts.append(name)
            n_in += shape[0]
        else:
            parts.append(_branch(graph, name))
            n_in += _WIDTHS[-1]
    joined = graph.add("Concat", parts, "joined", axis=1)
    hidden = graph.add("Gemm", [joined, graph.weight("w1", (32, n_in))], "h", transB=1)
    hidden = graph.add("Relu", [hidden], "hidden")
    out = graph.add("Gemm", [hidden, graph.weight("w2", (len(CLASSES), 32))], "logits", transB=1)
    info = helper.make_tensor_value_info(out, TensorProto.FLOAT, ["n", len(CLASSES)])
    made = helper.make_graph(graph.nodes, "blank", inputs, [info], graph.weights)
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", _OPSET)])
    model.ir_version = _IR
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))


def _branch(graph: _Graph, name: str) -> str:
    at = graph.add("Unsqueeze", [name, "channel_axis"], f"{name}.image")
    n_before = 1
    for k, width in enumerate(_WIDTHS):
        kernel = graph.weight(f"{name}.w{k}", (width, n_before, 3, 3))
        at = graph.add("Conv", [at, kernel], f"{name}.c{k}", strides=[2, 2], pads=[1, 1, 1, 1])
        at = graph.add("Relu", [at], f"{name}.r{k}")
        n_before = width
    pooled = graph.add("GlobalAveragePool", [at], f"{name}.pooled")
    return graph.add("Flatten", [pooled], f"{name}.flat", axis=1)
