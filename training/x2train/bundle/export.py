"""Export: torch to ONNX, and that onnxruntime computes the same."""

import inspect
import logging
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray

from radard.errors import RadardError
from radard.judge.bundle import ModelInput
from radard.judge.onnx_runtime import ort

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
