"""Own clips: recordings that people have labelled, and what the daemon's network saw in them.

The last line that `radard.web.labels` has of an event holds. By hand, FILE=LABEL names any
recording that `radard --port replay:` plays.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radard.config.config import Config
from radard.config.sections import AUTO_MODEL, DEFAULT_MODEL
from radard.errors import ModelMismatch, UsageError
from radard.judge.bundle import Bundle
from radard.judge.classifier import Answer, Classifier, Hidden
from radard.judge.features import Features
from radard.judge.model_choice import model_for
from radard.pipeline import Pipeline
from radard.web.labels import LABELS, label_lines
from x2radar.recording.registry import open_recording
from x2train.judge.judging import replayed
from x2train.nets.calibration import first_windows


@dataclass(frozen=True, slots=True)
class OwnClip:
    """A recording and what people say that it shows."""

    path: Path
    label: str  # human, pet, other, or wrong: an alarm that was for no human, whatever it was


def named_clips(arguments: Iterable[str]) -> tuple[OwnClip, ...]:
    """Return the clips of arguments FILE=LABEL; raise UsageError on a wrong one."""
    clips = []
    for text in arguments:
        name, _, label = text.rpartition("=")
        if not name or label not in LABELS:
            msg = f"'{text}': FILE=LABEL is wanted, with a label of {', '.join(LABELS)}"
            raise UsageError(msg)
        if not Path(name).is_file():
            raise UsageError(f"{name}: no such recording")
        clips.append(OwnClip(Path(name), label))
    return tuple(clips)


def labelled_clips(path: Path, folder: Path | None = None) -> tuple[list[OwnClip], list[str]]:
    """Return the clips of the dashboard's labels, in `folder`, and why others were left out."""
    try:
        lines = list(label_lines(path))
    except OSError as err:
        raise UsageError(f"{path}: cannot read the labels ({err})") from err
    strange = [number for number, line in enumerate(lines, 1) if line is None]
    clips, left_out = [], [f"line {number}: no label of the dashboard" for number in strange]
    for event, line in {line["event"]: line for line in lines if line}.items():
        clip = Path(str(line.get("clip") or ""))
        where = folder / clip.name if folder else clip
        if line.get("kind") != "alarm":
            left_out.append(f"{event}: labelled {line['label']}, but not an alarm")
        elif not clip.name:
            left_out.append(f"{event}: no clip was kept of it")
        elif not where.is_file():
            left_out.append(f"{event}: its clip is gone ({where})")
        else:
            clips.append(OwnClip(where, line["label"]))
    return clips, left_out


def merged(clips: Iterable[OwnClip]) -> tuple[OwnClip, ...]:
    """Return clips, each once; UsageError if one has two labels, or all are of people."""
    by_path: dict[Path, OwnClip] = {}
    for clip in clips:
        known = by_path.setdefault(clip.path.resolve(), clip)
        if known.label != clip.label:
            raise UsageError(f"{clip.path}: labelled both {known.label} and {clip.label}")
    if all(clip.label == "human" for clip in by_path.values()):
        msg = "no clip is labelled pet, other or wrong: there is nothing to quieten; label one"
        raise UsageError(msg)
    return tuple(by_path.values())


@dataclass(frozen=True, slots=True, eq=False)
class OwnWindows:
    """What the network saw of a clip, and what was decided."""

    clip: OwnClip  # the recording and its label
    sha256: str
    # (n, ...): by the network's input names; one row a window with the gate open
    inputs: Mapping[str, NDArray[np.float32]]
    t_s: NDArray[np.float64]  # (n,): stream time at the end of each, in seconds
    has_alarm: bool  # whether any decision was one

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
    alarms: list[bool] = []
    with open_recording(clip.path) as reader:
        try:
            pipeline = Pipeline(reader.stream, Config(), listener)
        except ModelMismatch as err:
            raise ModelMismatch(f"{clip.path}: {err}") from err
        for decision in replayed(reader, pipeline):
            alarms.append(decision.alarm)
            if decision.window is not None:
                # The whole window comes first, then what each track's own gate lets through.
                rows.append(listener.given[0])
                t_s.append(decision.t_s)
            listener.given.clear()
    if not rows:
        raise UsageError(f"{clip.path}: nothing moves in it; record a visit of at least 3 s")
    inputs = {each.name: np.stack([row[each.feature] for row in rows]) for each in bundle.inputs}
    digest = hashlib.sha256(clip.path.read_bytes()).hexdigest()
    return OwnWindows(clip, digest, inputs, np.array(t_s), any(alarms))
