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
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field

from radard.config.config import Config
from radard.config.json_file import parse_json
from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.decision import Decision
from radard.judge.model_choice import model_for
from radard.pipeline import Pipeline
from x2radar.bounded_yaml import load_yaml
from x2radar.recording.registry import open_recording
from x2train.judge.judging import from_decisions, replayed, with_policy
from x2train.judge.table import Columns, PassageTable


@dataclass(frozen=True, slots=True, kw_only=True)
class Labelled:
    """One row of the list; times are of the stream."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    file: Path
    label: Literal["human", "pet", "other", "empty"]
    start: Annotated[float, Field(ge=0)] = 0.0
    end: float | None = None  # to the end of the recording when not given


def read_list(path: Path) -> list[Labelled]:
    """Return the rows of a list; raise UsageError, naming file and row, if one makes no sense."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        if path.suffix.lower() in {".yaml", ".yml"}:
            raw = load_yaml(text)
        else:
            raw = list(csv.DictReader(text.splitlines(), skipinitialspace=True))
    except (OSError, ValueError, csv.Error) as err:
        first_line = str(err).partition("\n")[0]
        raise UsageError(f"{path}: cannot read the list of recordings ({first_line})") from err
    if not isinstance(raw, list) or not raw:
        raise UsageError(f"{path}: must be a list with the keys file, start, end and label")
    return [_row(path, number, row) for number, row in enumerate(raw, 1)]


def _row(path: Path, number: int, row: Any) -> Labelled:
    given = row
    if isinstance(row, Mapping):
        given = {key: value for key, value in row.items() if value not in {None, ""}}
    try:
        made = parse_json(Labelled, json.dumps(given, default=str), f"{path}, row {number}")
    except ValueError as err:
        raise UsageError(str(err)) from err
    if made.end is not None and made.end <= made.start:
        msg = f"{path}, row {number}: end {made.end:g}: must be after start {made.start:g}"
        raise UsageError(msg)
    return replace(made, file=path.parent / made.file)


def judge_labelled(rows: list[Labelled], model: str, policy: str = "") -> PassageTable:
    """Return a table of labelled stretches, judged from each recording's beginning on."""
    made: dict[Path, tuple[list[Decision], float]] = {}
    passages: list[Columns] = []
    for row in rows:
        if row.file not in made:
            made[row.file] = _decided(row.file, model, policy)
        decisions, length_s = made[row.file]
        end_s = length_s if row.end is None else min(row.end, length_s)
        inside = [d for d in decisions if row.start < d.t_s <= (row.end or np.inf)]
        if not inside:
            raise UsageError(f"{row.file}: no window ends between {row.start:g} and {end_s:g} s")
        here = {} if row.label == "empty" else {"enters_s": row.start, "leaves_s": end_s}
        passages.append(
            from_decisions(
                inside,
                family=row.label,
                label=row.label,
                split="recordings",
                suite=row.file.name,
                duration_s=end_s - row.start,
                **here,
            )
        )
    return PassageTable.of(passages)


def _decided(path: Path, model: str, policy: str) -> tuple[list[Decision], float]:
    """Return what radard decides on a recording, and how long that is."""
    with open_recording(path) as reader:
        bundle = load_bundle(model_for(model, reader.stream))
        config, classifier = with_policy(Config(), policy), Classifier(bundle)
        pipeline = Pipeline(reader.stream, config, classifier, judges_tracks=False)
        made = list(replayed(reader, pipeline))
        *_, last = reader.blocks(samples=False)
        return made, float(last.t_s[-1]) + 1 / reader.stream.frame_rate_hz
