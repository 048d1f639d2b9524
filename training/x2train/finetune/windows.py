"""Own windows: a recording through the daemon's own pipeline, and what its network was given."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radard.config.config import Config
from radard.config.sections import AUTO_MODEL, DEFAULT_MODEL
from radard.errors import ModelMismatch, UsageError
from radard.judge.bundle import Bundle
from radard.judge.classifier import Answer, Classifier, Hidden
from radard.judge.decision import Decision
from radard.judge.features import Features
from radard.judge.model_choice import model_for
from radard.pipeline import Pipeline
from x2radar.recording.registry import open_recording
from x2train.finetune.labels import OwnClip
from x2train.judge.judging import replayed
from x2train.nets.evidence_fit import first_windows

Maps = Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class OwnWindows:
    """What the network saw of a clip, and what was decided."""

    clip: OwnClip  # the recording and its label
    sha256: str
    inputs: Maps  # (n, ...): by the network's input names; one row a window with the gate open
    t_s: NDArray[np.float64]  # (n,): stream time at the end of each, in seconds
    n_alarms: int  # decisions with an alarm

    @property
    def is_first(self) -> NDArray[np.bool_]:
        """Where the gate has opened, shape (n,)."""
        return first_windows({"passage": np.zeros(len(self.t_s)), "t_s": self.t_s})


class _Listener(Classifier):
    """A classifier that keeps what it was given."""

    def __init__(self, bundle: Bundle) -> None:
        super().__init__(bundle)
        self.given: list[Features] = []

    def answer(self, features: Features, hidden: Hidden | None = None) -> Answer:
        self.given.append(features)
        return super().answer(features, hidden)


def judge_of(clips: Sequence[OwnClip]) -> str:
    """Return the name of the bundle that judges such clips when none is named."""
    if not clips:
        return DEFAULT_MODEL
    with open_recording(clips[0].path) as reader:
        return model_for(AUTO_MODEL, reader.stream)


def own_windows(clip: OwnClip, bundle: Bundle) -> OwnWindows:
    """Replay a clip; ModelMismatch, UsageError or X2RadarError if it is of no use."""
    listener = _Listener(bundle)
    rows: list[Features] = []
    t_s: list[float] = []
    n_alarms = 0
    with open_recording(clip.path) as reader:
        try:
            pipeline = Pipeline(reader.stream, Config(), listener)
        except ModelMismatch as err:
            raise ModelMismatch(f"{clip.path}: {err}") from err
        for decision in replayed(reader, pipeline):
            n_alarms += decision.alarm
            if decision.window is not None:
                # The whole window comes first, then what each track's own gate lets through.
                rows.append(listener.given[0])
                t_s.append(decision.t_s)
            listener.given.clear()
    if not rows:
        raise UsageError(f"{clip.path}: nothing moves in it; record a visit of at least 3 s")
    inputs = {each.name: np.stack([row[each.feature] for row in rows]) for each in bundle.inputs}
    digest = hashlib.sha256(clip.path.read_bytes()).hexdigest()
    return OwnWindows(clip, digest, inputs, np.array(t_s), n_alarms)


def decisions_on(clip: OwnClip, bundle: Bundle) -> list[Decision]:
    """Return what radard decides on a clip with a bundle."""
    with open_recording(clip.path) as reader:
        return list(replayed(reader, Pipeline(reader.stream, Config(), Classifier(bundle))))
