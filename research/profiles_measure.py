"""Candidates for profiles, their CPU time, and their errors on recorded motion."""

import json
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from levers import USUAL, Case, classifier, config_of
from radard.commands.bench import Heard, listen
from radard.config.config import Config
from radard.config.profiles import Bodies, with_rate
from radard.config.sections import AUTO_MODEL
from radard.detect.gate import DAY_S
from radard.judge.classifier import Classifier
from radard.judge.model_choice import model_for
from radard.pipeline import Pipeline
from radard.stream.source import open_source
from x2train.sets.workers import Tell

_OPEN, _ONE, _CLOSED = "open", "one", "closed"
_SCENES = {_OPEN: "sim:human", _ONE: "sim:human", _CLOSED: "sim:empty"}
Recorded = tuple[int, int, int, int]
"""People with an alarm, people, pets with an alarm, pets."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A bundle and settings."""

    model: str
    rate_hz: float = 60.0
    hop_s: float = 1.0
    bodies: Bodies = "together"

    @property
    def case(self) -> Case:
        """What `levers.measure` plays; what is made of several bodies changes no verdict."""
        radar = replace(USUAL.radar, frame_rate_hz=self.rate_hz)
        return Case(
            lever="profile",
            value=f"{self.model}, {self.rate_hz:g} Hz, hop {self.hop_s:g} s",
            setting=replace(USUAL, radar=radar),
            model=model_for(self.model),
            hop_s=self.hop_s,
        )

    @property
    def config(self) -> Config:
        """Its settings."""
        return Config.model_validate(
            {
                "model": {"name": model_for(self.model)},
                "decision": {"hop_s": self.hop_s, "bodies": self.bodies},
            }
        )


BEST = Candidate(AUTO_MODEL, bodies="apart")
"""The settings of who sets nothing."""


def candidates() -> tuple[Candidate, ...]:
    """Return all that is measured, what is usual last."""
    cheap: tuple[tuple[float, Bodies], ...] = (
        (20.0, "unfollowed"),
        (30.0, "unfollowed"),
        (30.0, "together"),
        (60.0, "together"),
    )
    made = [
        Candidate(model, rate_hz, 2.0, bodies)
        for model in ("fast", "balanced", AUTO_MODEL)
        for rate_hz, bodies in cheap
    ]
    made += [Candidate(AUTO_MODEL, rate_hz) for rate_hz in (30.0, 60.0)]
    return (*made, BEST)


def cpu_shares(
    tried: Sequence[Candidate], duration_s: float, rounds: int, tell: Tell
) -> dict[Candidate, dict[str, float]]:
    """Return the CPU time of every candidate in every condition, as a share of `BEST`'s open.

    `BEST` is measured again before every candidate, so that what else runs on the computer slows
    both; shares are medians over the rounds.
    """
    heard: dict[str, Heard] = {}

    def spent_s(each: Candidate, name: str) -> float:
        port = with_rate(_SCENES[name], each.rate_hz)
        if port not in heard:
            heard[port] = listen(port, duration_s)
        return _cpu_s(each, heard[port], classifier(each.case.model), name == _OPEN)

    found: dict[tuple[Candidate, str], list[float]] = {}
    for done in range(rounds):
        for each in tried:
            usual_s = spent_s(BEST, _OPEN)
            for name in _SCENES:
                is_usual = each == BEST and name == _OPEN
                share = 1.0 if is_usual else spent_s(each, name) / usual_s
                found.setdefault((each, name), []).append(share)
        tell(done + 1, rounds)
    return {each: {name: median(found[each, name]) for name in _SCENES} for each in tried}


def _cpu_s(each: Candidate, heard: Heard, judge: Classifier, is_open: bool) -> float:
    config = each.config
    if is_open:
        gate = config.gate.model_copy(update={"false_alarms_per_day": DAY_S})
        config = config.model_copy(update={"gate": gate})
    pipeline = Pipeline(heard.stream, config, judge)
    began_s = time.process_time()
    for dwell in pipeline.make_ring().dwells(heard.frames):
        pipeline.decide(dwell)
    heard_s = len(heard.frames) / heard.stream.frame_rate_hz
    return (time.process_time() - began_s) / heard_s


def judge_recorded(
    cases: Sequence[Case], folders: Sequence[Path], tell: Tell
) -> dict[Case, Recorded]:
    """Return what every case does to the recorded passages of folders.

    A folder has files of frames and a `truth.json`, a list of `file` and `label`. A case with
    fewer frames a second than a file has takes every second, third and so on; with more, none.
    """
    files = [
        (folder / each["file"], each["label"])
        for folder in folders
        for each in json.loads((folder / "truth.json").read_text("utf-8"))
    ]
    counts = {case: Counter[tuple[str, bool]]() for case in cases if files}
    for done, (path, label) in enumerate(files, 1):
        source = open_source(f"replay:{path}")
        stream, frames = source.stream, list(source.frames())
        source.close()
        for case, count in counts.items():
            every = round(stream.frame_rate_hz / case.setting.radar.frame_rate_hz)
            if every < 1:
                continue
            kept = [replace(f, index=k) for k, f in enumerate(frames[::every])]
            own = replace(stream, frame_rate_hz=stream.frame_rate_hz / every)
            pipeline = Pipeline(own, config_of(case), classifier(case.model), judges_tracks=False)
            dwells = pipeline.make_ring().dwells(kept)
            is_alarm = any(pipeline.decide(dwell).alarm for dwell in dwells)
            count[label, is_alarm] += 1
        tell(done, len(files))
    return {
        case: (
            *(n["human", True], n["human", True] + n["human", False]),
            *(n["pet", True], n["pet", True] + n["pet", False]),
        )
        for case, n in counts.items()
    }
