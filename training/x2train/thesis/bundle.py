"""A bundle of the thesis' network: the best of its repeats, as the daemon takes it."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from torch import nn

from radard.alarm.sensitivity import alarm_policy
from radard.config.config import Config
from radard.config.sections import AlarmSection
from radard.judge.bundle import Bundle, ModelInput
from radard.judge.classifier import Classifier
from radard.pipeline import Pipeline
from x2radar.frame import StreamInfo
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import parse_scene
from x2train.bundle.export import DIFFERENCE, exported
from x2train.bundle.writing import write_bundle
from x2train.judge.judging import dwells
from x2train.judge.verdicts import PET_LIMIT
from x2train.nets.calibration import temperature_of
from x2train.thesis.elements import CLUTTER
from x2train.thesis.fit import ACTIVATIONS, Fitted, Tell
from x2train.thesis.recipe import StudyRecipe, Variant, judged
from x2train.thesis.sets import Cell

CLASSES = ("pet", "human")
_MIN_STREAMS, _MAX_STREAMS, _ELEMENTS_A_STREAM = 4, 64, 40
"""Of streams that judge it: as much as fits a training on so many fresh elements."""
_X2 = {
    "bin_length_m": (0.0034, 0.0040),
    "carrier_hz": (6.4e9, 7.4e9),
    "bandwidth_hz": (2.0e9, 2.6e9),
}
"""About table B.5: all bins of an X2 in its lowest band."""
_RATE_SPREAD = 0.05  # frame rates this far from the data's show the same vectors
_VISIT_S = 6.0  # the quickest have left the swath by then


def write_thesis_bundle(
    path: Path, recipe: StudyRecipe, cell: Cell, variant: Variant, tell: Tell, *, command: str
) -> Mapping[str, float]:
    """Train a cell, write its best repeat as a bundle, calibrated and judged; its metrics."""
    fitted, evaluate, fresh, _ = recipe.train(cell, variant, tell)
    net = folded(fitted, fitted.best_repeat)
    feature = f"thesis_type{cell.vector}"
    inputs = (ModelInput("features", evaluate.x.shape[1:], feature),)
    onnx_bytes, difference = exported(net, inputs, {"features": evaluate.x})
    with torch.no_grad():
        known, z = (net(torch.from_numpy(each.x)).double().numpy() for each in (evaluate, fresh))
    temperature = temperature_of(known, evaluate.y)
    z /= temperature
    p = np.exp(z - np.logaddexp.reduce(z, axis=1, keepdims=True))
    result = judged(p[None], fresh.y)
    quiet, n_animals = p[:, 0] > PET_LIMIT, len(cell.bodies)
    alone = {body: quiet[2 * k :: 2 * n_animals] for k, body in enumerate(cell.bodies)}
    alone["human"], lone = quiet[1::2], "share of lone elements without alarm, "
    metrics = {
        "windows": float(result.n),
        "accuracy": result.total[0] / 100,
        "cross-entropy": result.cross_entropy[0],
        "accuracy pet": result.class1[0] / 100,
        "accuracy human": result.class2[0] / 100,
        **{lone + body: float(part.mean()) for body, part in alone.items()},
        DIFFERENCE: difference,
    }
    rate_hz = float(cell.frame_rate_hz)
    about_hz = (1 - _RATE_SPREAD) * rate_hz, (1 + _RATE_SPREAD) * rate_hz
    bundle = Bundle(
        name=path.name,
        onnx=onnx_bytes,
        inputs=inputs,
        features=recipe.spec(cell.frame_rate_hz).features,
        stream={"frame_rate_hz": about_hz, **_X2},
        classes=CLASSES,
        temperature=temperature,
        pet_limit=PET_LIMIT,
        policy="window",
        evidence={},
    )
    n_streams = max(_MIN_STREAMS, min(_MAX_STREAMS, recipe.n_fresh // _ELEMENTS_A_STREAM))
    metrics |= _stream_metrics(bundle, rate_hz, (*cell.bodies, "human"), n_streams, tell)
    layers = "-".join(map(str, fitted.net.sizes))
    animals = " and ".join(f"{body}s" for body in cell.bodies)
    text = (
        f"The thesis' network ({layers}, {fitted.net.activation}) on its type {cell.vector} "
        f"vector, trained on the thesis' five-sinusoid bodies: people against {animals} at "
        f"{cell.frame_rate_hz} Hz. A base line: it knows these bodies, not real motion."
    )
    training = {"recipe": text, "command": command, "seed": recipe.seed}
    metrics = {key: round(value, 4) if value > 1e-3 else value for key, value in metrics.items()}
    write_bundle(path.parent, bundle, training=training, metrics=metrics, gate={})
    return metrics


def folded(fitted: Fitted, repeat: int) -> nn.Sequential:
    """Return a repeat as a network of its own: inputs as they come, two logits."""
    net = fitted.net
    with torch.no_grad():
        weights = [each[repeat].double() for each in net.weights]
        biases = [each[repeat, 0].double() for each in net.biases]
    # (x - mean) scale W + b, as one product.
    weights[0] = weights[0] * torch.from_numpy(fitted.scale).double()[:, None]
    biases[0] = biases[0] - torch.from_numpy(fitted.mean).double() @ weights[0]
    if weights[-1].shape[1] == 1:
        # One logistic output is two of a softmax, of which the pet's is zero.
        weights[-1] = torch.cat([torch.zeros_like(weights[-1]), weights[-1]], dim=1)
        biases[-1] = torch.cat([torch.zeros_like(biases[-1]), biases[-1]])
    layers: list[nn.Module] = []
    for weight, bias in zip(weights, biases, strict=True):
        layer = nn.Linear(*weight.shape)
        layer.load_state_dict({"weight": weight.T.float(), "bias": bias.float()})
        layers += [layer, ACTIVATIONS[net.activation]()]
    return nn.Sequential(*layers[:-1]).eval()


def _stream_metrics(
    bundle: Bundle, rate_hz: float, bodies: tuple[str, ...], n: int, tell: Tell
) -> Mapping[str, float]:
    """Return, of `n` visits of each body, windows and visits with and without alarm.

    An element begins with a body somewhere on its way, often outside the swath. A stream has the
    module's noise and quantization, a room, the gate before the network, and window after window.
    """
    classifier, settings = Classifier(bundle), RadarSettings.for_frame_rate(rate_hz)
    info = StreamInfo(settings.axis, rate_hz, "x2raw")
    policy = alarm_policy(AlarmSection(), bundle.policy)
    metrics = {"streams of each body": float(n)}
    room = [{"range_m": range_m, "rcs_m2": rcs_m2} for range_m, rcs_m2 in CLUTTER]
    for body in bodies:
        quiet: list[bool] = []
        alarms = 0
        step = {"body": f"thesis_{body}", "duration_s": _VISIT_S}
        scene = parse_scene(json.dumps({"steps": [step], "clutter": room}), body, body)
        for seed in range(n):
            stream = EchoStream(scene, seed, settings)
            pipeline = Pipeline(info, Config(), classifier, judges_tracks=False)
            frames = (stream.next() for _ in range(round(_VISIT_S * rate_hz)))
            rows = (row for row in frames if row is not None)
            made = [pipeline.decide(each) for each in dwells(pipeline, rows, settings.axis)]
            quiet += [not d.alarm for d in made if d.gate == "open"]
            hits = np.array([d.alarm for d in made], float)
            alarms += bool((np.convolve(hits, np.ones(policy.n)) >= policy.k - 0.5).any())
            tell(f"streams of {body}", seed + 1, n)
        # `radard explain` reads these.
        metrics[f"share without alarm, {body}"] = float(np.mean(quiet)) if quiet else 1.0
        metrics[f"share of visits with an alarm, {body}"] = alarms / n
    return metrics
