"""Judging: a bundle in the daemon's own pipeline, on passages and labelled recordings.

No shortcut of training's is taken: clutter map, gate, tracks, features, onnxruntime and the
policy are those that run in `radard`.
"""

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from radard.config.config import Config
from radard.config.json_file import parse_json
from radard.errors import ModelMismatch, UsageError
from radard.judge.bundle import Bundle, load_bundle
from radard.judge.classifier import Classifier
from radard.judge.decision import Decision
from radard.judge.model_choice import model_for
from radard.pipeline import Pipeline
from radard.stream.ring import Dwell
from x2radar.bounded_yaml import load_yaml
from x2radar.frame import FastTimeAxis, Frame, StreamInfo
from x2radar.recording.blocks import BlockReader
from x2radar.recording.registry import open_recording
from x2train.judge.suites import SUITES, Suite, named_suites, suite_of
from x2train.judge.table import Columns, PassageTable, passage_columns
from x2train.sets.passages import Passage, level_db_of, play
from x2train.sets.sites import ONE_RADAR, Site
from x2train.sets.window_set import ADULT_DB, LEVEL_ERROR_DB

_IN_VIEW_DB = 10.0
_MIN_S = 0.5  # so long over a bin's noise somebody has come in: not at the swath's edge
_NAN = float("nan")
Knows = Literal["nothing", "mount", "mount and level"]
KNOWS: tuple[Knows, ...] = get_args(Knows)  # of itself, as `mount` tells the daemon
OWN_RADARS = "suites"  # every suite is played before its own radar


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgeSpec:
    """What a bundle is judged on, the same passages for all; UsageError if unknown."""

    model: str  # name or path of the bundle
    seed: int  # passage k draws from ``[seed, k]``
    n_passages: int  # the suites share them; numbers beyond are more visits of pets
    policy: str = ""  # 'window' or 'fused'; empty for the bundle's own
    # 'suites', or a name in `ONE_RADAR`: every passage is then before that one
    radar: str = OWN_RADARS
    only: tuple[str, ...] = ()  # names of suites that there are; empty for all

    def __post_init__(self) -> None:
        """Check the names of suites."""
        named_suites(self.only)

    def __call__(self, number: int) -> Mapping[str, NDArray[Any]]:
        """Return the columns of passage `number`, see `passage_columns`."""
        suite, played = self.suite(number), self.played(number)
        return from_decisions(
            decisions(played, self.model, self.policy),
            family=" with ".join(f.name for f in played.cast) or "empty room",
            label=played.cast[0].label if played.cast else "empty",
            split=suite.split,
            suite=suite.name,
            build=str(number),
            duration_s=len(played.frames) / played.site.radar.frame_rate_hz,
            **in_view(played),
        )

    def suite(self, number: int) -> Suite:
        """Return the suite of passage `number`, before its radar."""
        suite = suite_of(number, self.n_passages, self.only)
        return suite if self.radar == OWN_RADARS else suite.before(ONE_RADAR[self.radar])

    def check(self, bundle: Bundle) -> None:
        """Raise ModelMismatch, with what to do, if a bundle cannot take what would be played."""
        own = tuple(dict.fromkeys(s.radar for s in SUITES if s.radar is not None))
        choices = {OWN_RADARS: own, **{name: (radar,) for name, radar in ONE_RADAR.items()}}
        try:
            for radar in choices[self.radar]:
                bundle.check_stream(radar.axis(), radar.frame_rate_hz)
        except ModelMismatch as err:
            fitting = " or ".join(
                name
                for name, radars in choices.items()
                if all(bundle.takes(radar.axis(), radar.frame_rate_hz) for radar in radars)
            )
            instead = f"; it takes --radar {fitting}" if fitting else ""
            raise ModelMismatch(f"--radar {self.radar}: {err}{instead}") from err

    def played(self, number: int) -> Passage:
        """Simulate passage `number`: its suite, site and cast follow from the seed."""
        rng = np.random.default_rng([self.seed, number])
        suite = self.suite(number)
        cast = suite.families(rng)
        site = suite.drawn_site(rng)
        return play(rng, site, cast, duration_s=suite.duration_s, lead_s=(2.6, 4.0))


@lru_cache(maxsize=4)
def _classifier(model: str) -> Classifier:
    return Classifier(load_bundle(model))


def decisions(played: Passage, model: str, policy: str = "") -> list[Decision]:
    """Return what radard decides on a passage, by a bundle's name or path."""
    radar = played.site.radar
    pipeline = pipeline_for(model, radar.stream(), config_of(policy))
    return [pipeline.decide(each) for each in dwells(pipeline, played.frames, radar.axis())]


def pipeline_for(model: str, stream: StreamInfo, config: Config) -> Pipeline:
    """Return the daemon's pipeline for a stream, without tracks: a quarter of its time."""
    return Pipeline(stream, config, _classifier(model_for(model, stream)), judges_tracks=False)


def config_of(policy: str) -> Config:
    """Return the default configuration, with 'window', 'fused' or (empty) the bundle's policy."""
    return Config.model_validate({"decision": {"policy": policy or None}})


def dwells(
    pipeline: Pipeline, frames: Iterable[NDArray[Any]], axis: FastTimeAxis
) -> Iterator[Dwell]:
    """Yield what the daemon's own ring makes of frames: decimated as the bundle wants it."""
    numbered = (Frame(samples, k, k, 0, False, axis) for k, samples in enumerate(frames))
    return pipeline.make_ring().dwells(numbered)


def in_view(played: Passage) -> dict[str, float]:
    """Return when the first body is in view, and what it is like then; empty if it never is."""
    rate_hz, truth = played.site.radar.frame_rate_hz, played.truth
    seen = truth.snr_db[:, :1].ravel() > _IN_VIEW_DB
    if seen.sum() < _MIN_S * rate_hz:
        return {}
    first, last = np.flatnonzero(seen)[[0, -1]]
    speed = truth.speed_mps[seen, 0]
    share = np.abs(truth.velocity_mps[seen, 0]) / np.maximum(speed, 0.05)
    return {
        "enters_s": float(first / rate_hz),
        "leaves_s": float(last / rate_hz),
        "speed_mps": float(speed.mean()),
        "range_m": float(truth.range_m[seen, 0].mean()),
        "aspect_deg": float(np.degrees(np.arccos(np.clip(share.mean(), 0, 1)))),
        "snr_db": float(truth.snr_db[seen, 0].mean()),
    }


def replayed(reader: BlockReader, pipeline: Pipeline) -> Iterator[Decision]:
    """Yield what radard decides on a recording."""
    ring = pipeline.make_ring()
    for item in chain.from_iterable(map(ring.items, reader.frames(0.0))):
        if isinstance(item, Dwell):
            yield pipeline.decide(item)
        else:
            pipeline.restart()


def from_decisions(made: Sequence[Decision], **facts: Any) -> Columns:
    """Return a passage of decisions; `facts` are its texts and numbers."""
    readings = [d.reading for d in made]
    power_db = np.array([r.power_db if r else _NAN for r in readings])
    range_m = np.array([r.range_m if r and r.is_open else _NAN for r in readings])
    fused = [
        (f.pet + f.other, max(f.pet, f.other)) if (f := d.fused) else (_NAN,) * 2 for d in made
    ]
    quiet, most = np.array(fused).reshape(-1, 2).T
    windows = [(w.human, w.pet, w.other) if (w := d.window) else (_NAN,) * 3 for d in made]
    p = np.array(windows).reshape(-1, 3)
    return passage_columns(
        t_s=np.array([d.t_s for d in made]),
        is_open=np.array([d.gate == "open" for d in made], bool),
        is_pending=np.array([d.label == "pending" for d in made], bool),
        is_alarm=np.array([d.alarm for d in made], bool),
        p_human=p[:, 0],
        p_pet=p[:, 1],
        p_other=p[:, 2],
        fused_quiet=quiet,
        fused_most=most,
        power_db=power_db,
        target_range_m=range_m,
        compensated_db=power_db + 40 * np.log10(range_m),
        **facts,
    )


def installed(config: Config, site: Site, knows: Knows, rng: np.random.Generator) -> Config:
    """Return a configuration that says so much of a site; the level is as `rng` errs."""
    if knows == "nothing":
        return config
    known = {"height_m": site.antenna.height_m, "tilt_deg": site.antenna.tilt_deg}
    if knows == "mount and level":
        error_db = LEVEL_ERROR_DB * rng.standard_normal()
        known["level_db"] = float(level_db_of(site) + ADULT_DB + error_db)
    return config.model_copy(update={"mount": config.mount.model_copy(update=known)})


@dataclass(frozen=True, slots=True, kw_only=True)
class Labelled:
    """One row of the list; times are of the stream."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    file: Path
    label: Literal["human", "pet", "other", "empty"]
    start: Annotated[float, Field(ge=0)] = 0.0
    end: float | None = None  # to the end of the recording when not given


def read_list(path: Path) -> list[Labelled]:
    """Return the rows of a list; raise UsageError, naming file and row, if one makes no sense.

    It is a CSV file with the columns file, start, end and label, or a YAML list of mappings with
    these keys. Files are found from the list's folder; start and end are seconds of the recording,
    and may be missing where a label holds for all of it::

        file,start,end,label
        hall.h5,12.0,19.5,human
        hall.h5,40,75,pet
        night.h5,,,empty
    """
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
    if isinstance(row, Mapping):
        row = {key: value for key, value in row.items() if value not in (None, "")}
    try:
        made = parse_json(Labelled, json.dumps(row, default=str), f"{path}, row {number}")
    except ValueError as err:
        raise UsageError(str(err)) from err
    if made.end is not None and made.end <= made.start:
        msg = f"{path}, row {number}: end {made.end:g}: must be after start {made.start:g}"
        raise UsageError(msg)
    return replace(made, file=path.parent / made.file)


def judge_labelled(rows: list[Labelled], model: str, policy: str = "") -> PassageTable:
    """Return a table of labelled stretches, judged from each recording's beginning on."""
    files = dict.fromkeys(row.file for row in rows)
    decided = {file: _decided(file, model, policy) for file in files}
    passages: list[Columns] = []
    for row in rows:
        made, length_s = decided[row.file]
        end_s = length_s if row.end is None else min(row.end, length_s)
        inside = [d for d in made if row.start < d.t_s <= (row.end or np.inf)]
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
        pipeline = pipeline_for(model, reader.stream, config_of(policy))
        made = list(replayed(reader, pipeline))
        return made, float(reader.lists()[1][-1]) + 1 / reader.stream.frame_rate_hz
