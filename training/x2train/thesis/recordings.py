"""Labelled recordings as elements: windows of real frames, for the score and for retraining."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.dsp.downconvert import DownConverter
from radard.errors import UsageError
from radard.judge.features import extract
from radard.stream.ring import Dwell, DwellShape
from x2radar.frame import FastTimeAxis
from x2radar.recording.blocks import Label
from x2radar.recording.registry import open_recording
from x2train.thesis.elements import PROFILE, ElementSpec
from x2train.thesis.sets import CellData

CLASSES = {"pet": 0, "dog": 0, "cat": 0, "human": 1, "person": 1}


@dataclass(frozen=True, slots=True, eq=False)
class Recordings:
    """Windows of labelled recordings, with both vectors."""

    x: NDArray[np.float32]
    y: NDArray[np.int64]

    def of(self, vector: int) -> CellData:
        """Return them with the vector of a cell."""
        x = self.x if vector == 2 else np.ascontiguousarray(self.x[:, PROFILE:])
        return CellData(x, self.y, np.ones(len(self.y), np.float32))


def load_recordings(paths: Sequence[Path], spec: ElementSpec) -> Recordings:
    """Return the windows inside labels of recordings, hop one second.

    Labels are pet, dog, cat, human or person; others are left out. A recording may differ by 5 %
    in its rate from the spec's. Raises UsageError if one differs more, or none holds a labelled
    window of each class.
    """
    rows: list[NDArray[np.float32]] = []
    classes: list[int] = []
    for path in paths:
        reader = open_recording(str(path))
        rate_hz = reader.stream.frame_rate_hz
        if abs(rate_hz / spec.frame_rate_hz - 1) > 0.05:
            msg = f"{path}: {rate_hz:g} frames a second; these sets have {spec.frame_rate_hz}"
            raise UsageError(msg)
        labels = [label for label in reader.labels if label[2] in CLASSES]
        if not labels:
            msg = f"{path}: no labels of {', '.join(CLASSES)} in it"
            raise UsageError(msg)
        samples = np.stack([frame.samples for frame in reader.frames()])
        for label in labels:
            for dwell in _windows(samples, reader.stream.axis, label, spec):
                vector = extract(dwell, spec.features, ("thesis_type2",)).inputs["thesis_type2"]
                rows.append(vector)
                classes.append(CLASSES[label[2]])
    if len(set(classes)) < 2:
        msg = "recordings: both classes are needed, pets and people, for two seconds each"
        raise UsageError(msg)
    # In turn as far as they go, so that any part of them holds both.
    y = np.array(classes, np.int64)
    rank = np.empty(len(y))
    for c in (0, 1):
        rank[y == c] = np.linspace(0, 1, int((y == c).sum()), endpoint=False)
    order = np.lexsort((y, rank))
    return Recordings(np.stack(rows)[order], y[order])


def _windows(
    samples: NDArray[Any], axis: FastTimeAxis, label: Label, spec: ElementSpec
) -> Iterator[Dwell]:
    shape = DwellShape.of(
        dwell_s=spec.dwell_s, hop_s=1.0, frame_rate_hz=spec.frame_rate_hz, n_cpi=spec.n_cpi
    )
    first = round(label[0] * spec.frame_rate_hz)
    last = min(round(label[1] * spec.frame_rate_hz), len(samples))
    converter = DownConverter(axis)
    for at in range(first, last - shape.n_slow + 1, spec.frame_rate_hz):
        frames = converter.convert(samples[at : at + shape.n_slow])
        valid = np.ones(shape.n_slow, np.bool_)
        yield Dwell(frames, valid, converter.axis, spec.frame_rate_hz, at / spec.frame_rate_hz)
