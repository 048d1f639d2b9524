"""What bundles cost and reach: CPU time of the daemon's hop, timed here, and their accuracy."""

import contextlib
import json
import statistics
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radard.config.config import Config
from radard.errors import UsageError
from radard.judge.bundle import Bundle, load_bundle
from radard.judge.classifier import Answer, Classifier, Hidden
from radard.judge.features import FeatureSet
from radard.pipeline import Pipeline
from radard.stream.ring import Dwell
from research.tradeoff.measure import Recording
from x2radar.frame import Frame, StreamInfo

PROFILES = ("fast", "balanced", "accurate")
"""Bundles that `radard --profile` names."""


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Share of windows that are told right, 0 to 1, with its 95 % interval where known."""

    value: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True)
class ModelRow:
    """One bundle."""

    name: str
    is_profile: bool  # whether `radard --profile` knows it
    # CPU time of a hop with an open gate, in milliseconds: down-conversion, clutter, gate,
    # tracks, features and network, of the dwell and of every track in it
    ms_per_hop: float
    network_ms: float  # the network's part of it
    accuracy: Accuracy | None  # from its evaluation; None without one


def parse_model(text: str) -> tuple[str, Path | None]:
    """Return bundle and evaluation of ``NAME`` or ``NAME=EVALUATION.json``."""
    name, equals, file = text.partition("=")
    if not name or (equals and not file):
        msg = f"--models '{text}': must be NAME or NAME=EVALUATION.json"
        raise UsageError(msg)
    return name, Path(file) if file else None


def read_accuracy(path: Path) -> Accuracy:
    """Read the accuracy over windows out of an evaluation.

    A report has it (windows.balanced_accuracy), a bundle's sidecar (metrics), or an object with
    the key "accuracy". Raises UsageError if the file is no such thing.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
        found = _find(raw)
    except OSError as err:
        msg = f"{path}: cannot be read: {err.strerror}"
        raise UsageError(msg) from err
    except (ValueError, TypeError, KeyError, AttributeError) as err:
        msg = f"{path}: no evaluation that could be read ({err})"
        raise UsageError(msg) from err
    if found is None or not 0 <= found.value <= 1:
        msg = f"{path}: holds no accuracy: no windows.balanced_accuracy, metrics or accuracy"
        raise UsageError(msg)
    return found


def _find(raw: Mapping[str, Any]) -> Accuracy | None:
    windows = raw.get("windows")
    if isinstance(windows, Mapping) and "balanced_accuracy" in windows:
        estimate = windows["balanced_accuracy"]
        return Accuracy(float(estimate["value"]), estimate["low"], estimate["high"])
    metrics = raw.get("metrics", raw)
    for key in ("window balanced accuracy", "balanced accuracy", "accuracy"):
        if key in metrics:
            return Accuracy(float(metrics[key]))
    return None


def time_model(
    name: str, accuracy: Accuracy | None, recordings: list[Recording], rounds: int
) -> ModelRow:
    """Time a bundle on simulated scenes.

    Parameters
    ----------
    name : str
        Installed bundle, or a file.
    accuracy : Accuracy or None
        What is known of it.
    recordings : list of Recording
        Scenes that fit it.
    rounds : int
        How often; the best round counts.

    Returns
    -------
    ModelRow
        CPU times.

    Raises
    ------
    BundleError, ModelMismatch
        If the bundle cannot be used, or not for these streams.
    """
    bundle = load_bundle(name)
    hops_s, networks_s = [], []
    for _ in range(rounds):
        timed = [pair for r in recordings for pair in _time(_Timed(bundle), r)]
        if not timed:
            msg = "nothing moves in these scenes: the gate never opens"
            raise UsageError(msg)
        hops_s.append(statistics.median(hop_s for hop_s, _ in timed))
        networks_s.append(statistics.median(network_s for _, network_s in timed))
    return ModelRow(
        bundle.name, bundle.name in PROFILES, min(hops_s) * 1e3, min(networks_s) * 1e3, accuracy
    )


class _Timed(Classifier):
    """A classifier that adds up its CPU time."""

    def __init__(self, bundle: Bundle) -> None:
        super().__init__(bundle)
        self.used_s = 0.0

    def answer(self, features: FeatureSet, hidden: Hidden | None = None) -> Answer:
        started_s = time.thread_time()
        try:
            return super().answer(features, hidden)
        finally:
            self.used_s += time.thread_time() - started_s


def _time(classifier: _Timed, recording: Recording) -> list[tuple[float, float]]:
    """Return the seconds of hops with an open gate, and of the network in them."""
    axis, frames = recording.axes["rf"], recording.frames["rf"]
    stream = StreamInfo(axis, recording.frame_rate_hz, recording.scene)
    pipeline = Pipeline(stream, Config(), classifier)
    ring = pipeline.make_ring()
    timed = []
    hop_s = 0.0
    for k, samples in enumerate(frames):
        frame = Frame(samples, k + 1, k, 0, False, axis)
        started_s = time.thread_time()
        ring.push(frame)
        hop_s += time.thread_time() - started_s
        with contextlib.suppress(TimeoutError):
            dwell = ring.take(0)
            assert isinstance(dwell, Dwell)  # noqa: S101 - nothing else happens here
            classifier.used_s = 0.0
            started_s = time.thread_time()
            decision = pipeline.decide(dwell)
            hop_s += time.thread_time() - started_s
            # The first dwell is more than a hop.
            if decision.gate == "open" and decision.seq > 1:
                timed.append((hop_s, classifier.used_s))
            hop_s = 0.0
    return timed
