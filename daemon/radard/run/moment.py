"""One moment of a recording: what was decided, why, and what the network saw."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from radard.alarm.explain import explain
from radard.config.config import Config
from radard.errors import UsageError
from radard.judge.bundle import Bundle
from radard.judge.classifier import Answer, Classifier, Hidden, Probabilities
from radard.judge.features import Features, FeatureSettings
from radard.judge.occlusion import Seen
from radard.outputs.records import Record
from radard.run.components import use_calibration
from radard.run.listening import listen
from radard.run.replays import replay_into, replaying
from radard.stream.ring import Notice

_PAST_S = 1.0
"""A window may end so long behind the moment that is asked for: one hop."""


@dataclass(frozen=True, slots=True)
class Moment:
    """A decision of a recording.

    `records` are the decisions up to this one, `told` is what `radard.alarm.explain` makes of
    them, and `seen` is None where no network was asked: the gate was closed, or there is none.
    """

    path: Path
    hello: Record
    records: Sequence[Record]
    told: Mapping[str, Any]
    classifier: Classifier | None
    settings: FeatureSettings
    seen: Seen | None

    @property
    def record(self) -> Record:
        """The decision."""
        return self.records[-1]

    @property
    def pet_limit(self) -> float:
        """No alarm above it."""
        return float(self.hello["pet_limit"])


class _Watched(Classifier):
    """A classifier that keeps what it was last asked about the whole dwell."""

    def __init__(self, bundle: Bundle) -> None:
        super().__init__(bundle)
        self.seen: Seen | None = None

    def classify(self, features: Features) -> Probabilities:
        """As in `Classifier`; of single bodies, which are not kept."""
        return super().answer(features).window

    def answer(self, features: Features, hidden: Hidden | None = None) -> Answer:
        """As in `Classifier`."""
        answer = super().answer(features, hidden)
        self.seen = Seen(features, hidden, answer)
        return answer


def moment_of(path: Path, at_s: float, config: Config) -> Moment:
    """Return the decision whose window ends nearest to `at_s` seconds of a recording.

    Raises UsageError if the recording has no decision by then; RadardError or X2RadarError if it
    cannot be read or the model does not fit it.
    """
    with TemporaryDirectory(prefix="radard-why-") as folder:
        kept = Path(folder) / "records.jsonl"
        replay_into(kept, config, path, until_s=at_s + 2 * _PAST_S)
        records = [json.loads(line) for line in kept.read_text("utf-8").splitlines()]
    decisions = [r for r in records if r["type"] == "decision"]
    if not decisions:
        msg = f"--at {at_s:g}: {path} has no decision before {at_s + _PAST_S:g} s"
        raise UsageError(msg)
    nearest = min(decisions, key=lambda r: abs(r["t_s"] - at_s))
    if abs(nearest["t_s"] - at_s) > 2 * _PAST_S:
        first, last = decisions[0]["t_s"], decisions[-1]["t_s"]
        msg = f"--at {at_s:g}: {path} has decisions from {first:g} to {last:g} s"
        raise UsageError(msg)
    before = [r for r in decisions if r["seq"] <= nearest["seq"]]
    hello = next(r for r in records if r["type"] == "hello")
    told = explain(before, hello, config, _events_by(records, nearest["t_s"]))
    settings, classifier, seen = _look_on(path, config, int(nearest["seq"]))
    return Moment(path, hello, before, told, classifier, settings, seen)


def _events_by(records: Sequence[Record], t_s: float) -> list[Record]:
    """Return the events as they stood at some time, the last phase of each."""
    events = {r["id"]: r for r in records if r["type"] == "event" and r["t_s"] <= t_s}
    return list(events.values())


def _look_on(
    path: Path, config: Config, seq: int
) -> tuple[FeatureSettings, Classifier | None, Seen | None]:
    """Replay up to a decision; return the settings, the network and what it saw there."""
    with listen(replaying(config, path)) as listening:
        pipeline = listening.pipeline
        use_calibration(config, pipeline, is_live=False)
        plain = pipeline.classifier
        watched = _Watched(plain.bundle) if plain is not None else None
        pipeline.classifier = watched
        n = 0
        for item in listening.dwells(math.inf):
            if isinstance(item, Notice):
                pipeline.restart()
                continue
            if watched is not None:
                watched.seen = None
            pipeline.decide(item)
            n += 1
            if n == seq:
                features = watched.bundle.features if watched else FeatureSettings()
                settings = features.at(pipeline.stream.frame_rate_hz)
                return settings, watched, watched.seen if watched else None
    msg = f"{path}: the recording ends before decision {seq}"
    raise UsageError(msg)
