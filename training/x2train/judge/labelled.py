"""Labelled recordings of one's own: who was there from when to when, judged as radard judges them.

The list is a CSV file with the columns file, start, end and label, or a YAML list of mappings
with these keys. Files are found from the list's folder; start and end are seconds of the
recording, and may be missing where a label holds for all of it::

    file,start,end,label
    hall.h5,12.0,19.5,human
    hall.h5,40,75,pet
    night.h5,,,empty
"""

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from radard.config.config import Config
from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.decision import Decision
from radard.judge.model_choice import model_for
from radard.pipeline import Pipeline
from radard.stream.ring import Dwell
from x2radar.bounded_yaml import load_yaml
from x2radar.recording.registry import open_recording
from x2train.judge.judging import from_decisions
from x2train.judge.table import LABELS, Columns, PassageTable

_KEYS = ("file", "start", "end", "label")


@dataclass(frozen=True, slots=True)
class Labelled:
    """One row of the list."""

    file: Path
    start_s: float  # stream time
    end_s: float  # infinite: to the end of the recording
    label: str  # of `LABELS`


def read_list(path: Path) -> list[Labelled]:
    """Return the rows of a list; raise UsageError, naming file and row, if one makes no sense."""
    try:
        text = path.read_text(encoding="utf-8")
        if path.suffix.lower() in {".yaml", ".yml"}:
            raw = load_yaml(text)
        else:
            raw = list(csv.DictReader(text.splitlines(), skipinitialspace=True))
    except (OSError, ValueError, csv.Error) as err:
        first_line = str(err).partition("\n")[0]
        msg = f"{path}: cannot read the list of recordings ({first_line})"
        raise UsageError(msg) from err
    if not isinstance(raw, list) or not raw:
        msg = f"{path}: must be a list with the keys {', '.join(_KEYS)}"
        raise UsageError(msg)
    return [_row(path, number, row) for number, row in enumerate(raw, 1)]


def _row(path: Path, number: int, row: Any) -> Labelled:
    where = f"{path}, row {number}"
    if not isinstance(row, Mapping) or not row.get("file") or set(row) - set(_KEYS):
        msg = f"{where}: must have the keys {', '.join(_KEYS)}, and no others"
        raise UsageError(msg)
    label = str(row.get("label") or "").strip()
    if label not in LABELS:
        msg = f"{where}: label '{label[:40]}': must be one of {', '.join(LABELS)}"
        raise UsageError(msg)
    start_s, end_s = (_second(where, key, row.get(key)) for key in ("start", "end"))
    start_s, end_s = 0.0 if start_s is None else start_s, np.inf if end_s is None else end_s
    if not 0 <= start_s < end_s:
        msg = f"{where}: start {start_s:g} and end {end_s:g}: must be seconds, one after the other"
        raise UsageError(msg)
    return Labelled(path.parent / str(row["file"]).strip(), start_s, end_s, label)


def _second(where: str, key: str, value: Any) -> float | None:
    if value is None or value == "":
        return None
    try:
        return float(value)
    except (TypeError, ValueError) as err:
        msg = f"{where}: {key} '{str(value)[:40]}': must be seconds"
        raise UsageError(msg) from err


def judge_labelled(rows: list[Labelled], model: str, policy: str = "") -> PassageTable:
    """Return a table of the rows, judged from the beginning of each recording on.

    A row's decisions are those of windows that end within it.

    Raises
    ------
    UsageError
        If no window ends within a row.
    X2RadarError, RadardError
        If a recording cannot be read, or the bundle was not made for such a stream.
    """
    made: dict[Path, tuple[list[Decision], float]] = {}
    passages: list[Columns] = []
    for row in rows:
        if row.file not in made:
            made[row.file] = _decided(row.file, model, policy)
        decisions, length_s = made[row.file]
        inside = [d for d in decisions if row.start_s < d.t_s <= row.end_s]
        if not inside:
            msg = f"{row.file}: no window ends between {row.start_s:g} and {row.end_s:g} s"
            raise UsageError(msg)
        end_s = min(row.end_s, length_s)
        here = {} if row.label == "empty" else {"enters_s": row.start_s, "leaves_s": end_s}
        passages.append(
            from_decisions(
                inside,
                family=row.label,
                label=row.label,
                split="recordings",
                suite=row.file.name,
                duration_s=end_s - row.start_s,
                **here,
            )
        )
    return PassageTable.of(passages)


def _decided(path: Path, model: str, policy: str) -> tuple[list[Decision], float]:
    """Return what radard decides on a recording, and how long that is."""
    reader = open_recording(str(path))
    config = Config()
    if policy:
        section = config.decision.model_copy(update={"policy": policy})
        config = config.model_copy(update={"decision": section})
    bundle = load_bundle(model_for(model, reader.stream))
    pipeline = Pipeline(reader.stream, config, Classifier(bundle), judges_tracks=False)
    ring, end_s = pipeline.make_ring(), 0.0

    def dwells() -> Iterator[Dwell]:
        nonlocal end_s
        for frame in reader.frames(0.0):
            end_s = (frame.index + 1) / reader.stream.frame_rate_hz
            yield from (item for item in ring.items(frame) if isinstance(item, Dwell))

    return [pipeline.decide(dwell) for dwell in dwells()], end_s
