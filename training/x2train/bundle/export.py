"""Export: torch to ONNX, parity with onnxruntime, sidecar and card."""

import hashlib
import inspect
import json
import logging
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray

from radard.errors import RadardError
from radard.judge.bundle import SCHEMA, Bundle, ModelInput
from radard.judge.features import FeatureSettings
from radard.judge.onnx_runtime import ort
from x2radar.command import installed_version
from x2train.bundle.recipes import recipe_of
from x2train.sets.shards import write_whole

PARITY = 1e-5  # most that torch and onnxruntime may differ: single precision
_NOTES = """Measured on windows that training never saw, drawn from the same simulated bodies. They
say nothing about real people and pets."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BundleSpec:
    """What the sidecar and the card say beside the network."""

    name: str
    inputs: tuple[ModelInput, ...]  # what goes in, in the order in which the network takes it
    settings: FeatureSettings
    stream: dict[str, tuple[float, float]]  # ranges of streams it was made for
    classes: tuple[str, ...]  # order of the outputs
    temperature: float  # logits are divided by it
    training: dict[str, Any]  # recipe, command and seed
    metrics: dict[str, Any]  # measured on data that training never saw
    policy: str = "window"  # 'window' or 'fused'
    evidence: dict[str, float] = field(default_factory=dict)  # how windows are fused, for 'fused'
    # settings of the gate that chose the windows to train on; empty where not known
    gate: Mapping[str, float] = field(default_factory=dict)
    notes: str = ""  # for the card: what the figures mean, and what they do not
    # the alarm stays off only above this probability of pet and other together
    pet_limit: float = 0.8
    # values that a temporal head hands itself from window to window; 0 without one
    n_hidden: int = 0


def spec_like(base: Bundle, **own: Any) -> BundleSpec:
    """Return the spec of a bundle made from another: what `own` does not give is the other's.

    Of `own`, values of `BundleSpec`, name, training and metrics are needed.
    """
    same: dict[str, Any] = {
        "inputs": base.inputs,
        "settings": base.features,
        "stream": dict(base.stream),
        "classes": base.classes,
        "temperature": base.temperature,
        "policy": base.policy,
        "evidence": dict(base.evidence),
        "pet_limit": base.pet_limit,
        "n_hidden": base.n_hidden,
    }
    return BundleSpec(**{**same, **own})


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
    for item in (*model.graph.node, *model.graph.value_info, *model.graph.input):
        item.doc_string = ""
        if hasattr(item, "metadata_props"):
            del item.metadata_props[:]
    for item in (*model.graph.output, *model.graph.initializer):
        item.doc_string = ""
        if hasattr(item, "metadata_props"):
            del item.metadata_props[:]
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))


def parity(net: torch.nn.Module, onnx_bytes: bytes, x: Mapping[str, NDArray[np.float32]]) -> float:
    """Return the largest difference of any logit between torch and onnxruntime.

    `x` are the inputs by name, in the network's order.
    """
    session = ort.InferenceSession(onnx_bytes, providers=["CPUExecutionProvider"])
    ours = session.run(None, dict(x))[0]
    with torch.no_grad():
        theirs = net(*(torch.from_numpy(each) for each in x.values())).numpy()
    return float(np.abs(np.asarray(ours) - theirs).max())


def checked(difference: float, most: float) -> float:
    """Return how far onnxruntime is from torch; raise RadardError if over the most allowed."""
    if not difference <= most:
        msg = f"torch and onnxruntime differ by {difference:.2g} (at most {most:g} allowed)"
        raise RadardError(msg)
    return difference


def write_bundle(folder: Path, spec: BundleSpec, onnx_bytes: bytes) -> None:
    """Write NAME.onnx, NAME.json and NAME.md, each at once or not at all."""
    sidecar = {
        "schema": SCHEMA,
        "name": spec.name,
        "onnx_sha256": hashlib.sha256(onnx_bytes).hexdigest(),
        "inputs": [
            {"name": i.name, "shape": list(i.shape), "feature": i.feature} for i in spec.inputs
        ],
        "features": asdict(spec.settings),
        "stream": {key: list(value) for key, value in spec.stream.items()},
        "classes": list(spec.classes),
        "temperature": spec.temperature,
        "pet_limit": spec.pet_limit,
        "policy": spec.policy,
        **({"evidence": spec.evidence} if spec.evidence else {}),
        **({"hidden": spec.n_hidden} if spec.n_hidden else {}),
        **({"gate": dict(spec.gate)} if spec.gate else {}),
        "training": {
            **spec.training,
            "versions": {
                **{name: version(name) for name in ("torch", "onnx", "numpy")},
                "x2radar": installed_version(),
            },
        },
        "metrics": spec.metrics,
    }
    for suffix, data in (
        (".onnx", onnx_bytes),
        (".json", (json.dumps(sidecar, indent=2) + "\n").encode()),
        (".md", _card(sidecar, len(onnx_bytes), spec.notes).encode()),
    ):
        write_whole(folder / f"{spec.name}{suffix}", data)


def _card(sidecar: dict[str, Any], n_bytes: int, notes: str) -> str:
    rows = "\n".join(f"| {key} | {value} |" for key, value in sidecar["metrics"].items())
    stream = "\n".join(f"| {k} | {lo:g} to {hi:g} |" for k, (lo, hi) in sidecar["stream"].items())
    training = sidecar["training"]
    inputs = ", ".join(f"`{i['feature']}`" for i in sidecar["inputs"])
    recipe = recipe_of(training["command"])
    gate = ", ".join(f"{key} {value:g}" for key, value in sidecar.get("gate", {}).items())
    whole = f"\n\nand with its sets by\n\n    train-export make {recipe}" if recipe else ""
    return f"""# Model `{sidecar["name"]}`

{training["recipe"]}

Made by one command (same seed, same file on one machine):

    {training["command"]}{whole}

{notes or _NOTES}

| measure | value |
|---|---|
{rows}

For streams of

| | |
|---|---|
{stream}

Classes: {", ".join(sidecar["classes"])}. No alarm above {sidecar["pet_limit"]:g} pet. Policy
`{sidecar["policy"]}`. Inputs {inputs}, {n_bytes} bytes of weights.{gate and f" Gate: {gate}."}
"""
