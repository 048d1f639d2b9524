"""Bundles with a temporal head: what it learns from, metrics, and the files."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from radard.judge.bundle import Bundle, sidecar_path
from x2train.bundle.export import DIFFERENCE, GIVEN, checked, n_parameters, with_given, with_head
from x2train.bundle.metrics import NOTES, gate_of, kept_out_of, rounded, window_metrics
from x2train.bundle.writing import write_bundle
from x2train.nets.bundle_answers import Answers, outputs_of
from x2train.nets.calibration import Trained, first_windows, fit_evidence, log_loss
from x2train.nets.calibration import fused as summed
from x2train.nets.temporal_head import Given, TemporalHead, logits_over
from x2train.sets.window_set import Columns, check_made_for, inputs_of, load_windows

HUMAN_LIMIT = {"fast": 0.65, "balanced": 0.8, "accurate": 0.9}
"""From which fused probability of a person on an alarm does not wait, by the head's size: of these
three the highest that leaves the median time to alarm under 3 s. Their misses are the same
(docs/research/evaluation-tried.md)."""
_N_SAMPLE = 512  # windows that torch and onnxruntime are compared on
_MEAN = " It is the mean of {n} networks, trained apart."
_RECIPE = (
    " A temporal head (GRU) integrates evidence over successive windows. Families kept out of "
    "its training: {kept_out}."
)


@dataclass(frozen=True, slots=True, eq=False)
class Sets:
    """Windows of sets, as a head sees them."""

    given: Given
    logits: NDArray[np.float64]
    sample: Columns


def given_of_sets(bundle: Bundle, folders: Sequence[Path]) -> tuple[Sets, list[Mapping[str, Any]]]:
    """Return what a bundle's last layer is given of sets, and what each was made from."""
    network = with_given(bundle.onnx)
    made, logits = [], []
    abouts: list[Mapping[str, Any]] = []
    sample: Columns = {}
    for folder in folders:
        columns, about = load_windows(folder)
        check_made_for(bundle, columns, about[0], folder)
        answers = outputs_of(network, inputs_of(bundle, columns), tap=GIVEN)
        label = np.asarray(columns["label"], np.int64)
        log_p = log_softmax(answers.logits / bundle.temperature, axis=1)
        made.append(Given(answers.tapped, log_p.astype(np.float32), label, first_windows(columns)))
        logits.append(answers.logits)
        abouts += about
        sample = sample or {key: values[:_N_SAMPLE] for key, values in columns.items()}
    parts = ([getattr(g, f.name) for g in made] for f in fields(Given))
    return Sets(Given(*map(np.concatenate, parts)), np.concatenate(logits), sample), abouts


def write_temporal(
    folder: Path,
    name: str,
    models: Sequence[str],
    base: Bundle,
    trained: Trained[TemporalHead],
    *,
    validation: Sets,
    abouts: Sequence[Mapping[str, Any]],
    command: str,
    evidence: Mapping[str, float],
) -> Mapping[str, float]:
    """Write the bundle with its head; return its metrics.

    `models` are the bundles that it was made from and `base` these as one (`joined`),
    `validation` passages that training never saw; `abouts`, what the sets to train on were made
    from, and `command` are for the card, behind the base's command; `evidence` holds `human_limit`
    and more of `EvidenceSettings`. Raises RadardError if onnxruntime and torch do not agree.
    """
    onnx = with_head(base.onnx, trained, base.temperature)
    given = validation.given
    fused = logits_over(trained.net, given) / trained.temperature
    n = len(validation.sample["label"])
    inputs = inputs_of(base, validation.sample)
    made = outputs_of(onnx, inputs, is_first=given.is_first[:n])
    assert made.fused is not None  # noqa: S101 - the network has a head
    difference = checked(float(np.abs(made.fused - fused[:n]).max()))
    is_human = given.label == 0
    p = Answers(validation.logits).p(base.temperature)
    best = fit_evidence(p, given.is_first, is_human)
    log_p = fused - np.logaddexp.reduce(fused, axis=1, keepdims=True)
    metrics = rounded(
        {
            "parameters": float(n_parameters(onnx)),
            **window_metrics(p, given.label),
            "log loss, windows summed": log_loss(summed(p, given.is_first, best), is_human),
            "log loss, fused": log_loss(np.exp(log_p[:, 0]), is_human),
        }
    )
    known = _known(models)
    changed: dict[str, Any] = {"policy": "fused", "n_hidden": trained.net.n_hidden}
    bundle = replace(base, name=name, onnx=onnx, evidence=evidence, **changed)
    training = {
        **known,
        "recipe": known["recipe"] + _RECIPE.format(kept_out=kept_out_of(abouts)),
        "command": f"{known['command']} && {command}",
        "temporal": {"base_onnx_sha256": base.sha256, "sets": list(abouts)},
    }
    write_bundle(
        folder,
        bundle,
        training=training,
        metrics={**metrics, DIFFERENCE: difference},
        gate=gate_of(abouts),
        notes=NOTES,
    )
    return metrics


def _known(models: Sequence[str]) -> dict[str, Any]:
    """Return what a bundle's card says of the bundles that it is made from: one, or several."""
    cards = [json.loads(sidecar_path(model).read_bytes()) for model in models]
    first, *others = (card["training"] for card in cards)
    if not others:
        return dict(first)
    commands = dict.fromkeys(
        part for each in (first, *others) for part in each["command"].split(" && ")
    )
    return {
        **first,
        "recipe": first["recipe"] + _MEAN.format(n=len(models)),
        "command": " && ".join(commands),
        "joined": [{"name": card["name"], "onnx_sha256": card["onnx_sha256"]} for card in cards],
    }
