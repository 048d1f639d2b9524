"""What a bundle of maps is calibrated to, and its metrics."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from radard.judge.bundle import CLASSES, EvidenceSettings
from x2train.judge.estimates import Ranking
from x2train.judge.verdicts import PET_LIMIT
from x2train.nets.bundle_answers import Answers
from x2train.nets.calibration import Trained, first_windows, fit_evidence, fused, log_loss
from x2train.nets.map_fit import Arrays, logits_of
from x2train.nets.nets import MapNet

TRUST = 2 / 3
"""Share of the discount that fits families of training with which a bundle is shipped. A twin
counts windows of families that it had not seen 0.3 and those of its own 0.6: evidence of
movements that nobody has trained is worth less, and this is half-way."""
HUMAN_LIMIT = 0.65
PRIOR_HUMAN = {"fast": 0.0, "balanced": 0.25, "accurate": 0.25, "large": 0.25}
"""How policies that sum lean towards the alarm, by size of the network. Chosen on 1600 passages
that neither training nor docs/evaluation.md uses."""
N_SAMPLE = 256  # windows that torch and onnxruntime are compared on
NOTES = (
    "Measured on windows of passages that training never saw: new draws of the families it "
    "was trained on. What it does on bodies, rooms and radars that it was not trained on is in "
    "the evaluation report, docs/evaluation.md. All of it is simulation: no figure here was "
    "measured on a real pet."
)
"""What the figures on a card mean, and what they do not."""


def check_calibration(label: NDArray[Any]) -> None:
    """Raise UsageError if nothing can be calibrated on windows of such classes."""
    if len(np.unique(label == 0)) < 2:
        raise UsageError("the windows to validate on must be of people and others")


def kept_out_of(abouts: Sequence[Mapping[str, Any]]) -> str:
    """Return which families sets to train on leave out, for a card."""
    has_all = {about["use"] for about in abouts} & {"all", "held out"}
    return "none" if has_all else "as `x2train.sets.families` lists them"


def gate_of(abouts: Sequence[Mapping[str, Any]]) -> Mapping[str, float]:
    """Return the gate's settings that sets were made with; none if not all record the same."""
    gates = [about.get("gate", {}) for about in abouts]
    return gates[0] if all(gate == gates[0] for gate in gates) else {}


def map_metrics(
    trained: Trained[MapNet], validation: Arrays, prior_human: float = PRIOR_HUMAN["balanced"]
) -> tuple[EvidenceSettings, Mapping[str, float]]:
    """Return how evidence is best fused, and what windows and fused values achieve.

    `validation` are windows of passages that training never saw, in order within each;
    `prior_human` is how far the policy leans, in nats. The settings have `TRUST` times the
    discount of the lowest log loss; that in the metrics is of the best discount, without a prior.
    """
    label = np.asarray(validation["label"])
    logits = logits_of(trained.net, validation)
    p = Answers(logits).p(trained.temperature)
    is_human = label == 0
    is_first = first_windows(validation)
    evidence = fit_evidence(p, is_first, is_human)
    metrics = {
        "parameters": float(sum(p.numel() for p in trained.net.parameters())),
        **window_metrics(p, label),
        "log loss, fused": log_loss(fused(p, is_first, evidence), is_human),
    }
    trusted = replace(
        evidence,
        discount=round(TRUST * evidence.discount, 2),
        prior_human=prior_human,
        human_limit=HUMAN_LIMIT,
    )
    return trusted, rounded(metrics)


def window_metrics(p: NDArray[np.float64], label: NDArray[np.int64]) -> dict[str, float]:
    """Return what single windows achieve, by their calibrated probabilities, shape (n, 3)."""
    is_human, is_body = label == 0, label < CLASSES.index("other")
    odds = p[is_body, 0] / np.maximum(p[is_body, :2].sum(axis=1), 1e-12)
    return {
        "windows": float(len(label)),
        "window AUC, human against pet": Ranking(odds, label[is_body] == 0).auc(),
        "window AUC, human against all else": Ranking(p[:, 0], is_human).auc(),
        "balanced accuracy": float(
            np.mean([(p.argmax(axis=1) == label)[label == k].mean() for k in np.unique(label)])
        ),
        **shares_without_alarm(p[:, 1] + p[:, 2] > PET_LIMIT, label),
        "log loss of a window": log_loss(p[:, 0], is_human),
    }


def shares_without_alarm(quiet: NDArray[np.bool_], label: NDArray[np.int64]) -> dict[str, float]:
    """Return of which share of the windows of each class the rule alone keeps quiet."""
    return {
        f"share without alarm, {name}": float(quiet[label == k].mean())
        for k, name in enumerate(("person", "pet", "thing"))
        if (label == k).any()
    }


def rounded(metrics: Mapping[str, float]) -> dict[str, float]:
    """Return the metrics that are known, to four digits."""
    return {key: round(float(v), 4) for key, v in metrics.items() if np.isfinite(v)}
