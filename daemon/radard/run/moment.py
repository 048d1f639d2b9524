"""One moment of a recording: what was decided, why, and what the network saw."""

import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radard.alarm.explain import explain
from radard.config.config import Config
from radard.errors import UsageError
from radard.judge.bundle import Bundle
from radard.judge.classifier import Answer, Classifier, Hidden
from radard.judge.features import Features, FeatureSettings
from radard.judge.occlusion import Seen
from radard.outputs.fanout import Outputs
from radard.outputs.records import Record
from radard.pipeline import Pipeline
from radard.run.replays import replay, replaying

_PAST_S = 1.0  # so late a window may end behind the moment asked for


@dataclass(frozen=True, slots=True)
class Moment:
    """A decision, the `records` up to it, what it is `told` by, and `seen` by a network."""

    path: Path
    hello: Record
    records: Sequence[Record]
    told: Mapping[str, Any]
    classifier: Classifier | None
    seen: Seen | None

    @property
    def record(self) -> Record:
        """The decision nearest to the time that was asked for."""
        return self.records[-1]

    @property
    def settings(self) -> FeatureSettings:
        """How the network's features were made."""
        settings = self.classifier.bundle.features if self.classifier else FeatureSettings()
        return settings.at(self.hello["frame_rate_hz"])

    @property
    def pet_limit(self) -> float:
        """p(pet) + p(other) above which there was no alarm."""
        return float(self.hello["pet_limit"])


class _Watched(Classifier):
    """A classifier that keeps what it was first asked, about the whole dwell, until that goes."""

    def __init__(self, bundle: Bundle) -> None:
        super().__init__(bundle)
        self.seen: Seen | None = None

    def answer(self, features: Features, hidden: Hidden | None = None) -> Answer:
        """Answer as the classifier does, and keep what went in and came out."""
        answer = super().answer(features, hidden)
        self.seen = self.seen or Seen(features, hidden, answer)
        return answer


class _Kept(Outputs):
    """Keeps the records of a replay, and what the network saw nearest to some time."""

    def __init__(self, at_s: float) -> None:
        super().__init__(stdout_is_terminal=False)
        self._at_s = at_s
        self.records: list[Record] = []
        self.nearest: Record = {}
        self.off_s = math.inf  # how far that is from the time
        self.classifier: _Watched | None = None
        self.seen: Seen | None = None

    def watch(self, pipeline: Pipeline) -> None:
        """Look on while a pipeline decides."""
        if pipeline.classifier is not None:
            self.classifier = pipeline.classifier = _Watched(pipeline.classifier.bundle)

    def put(self, record: Record, sensor: str | None = None, *, waits: bool = False) -> bool:
        """Keep a record, and what the network saw if no decision was nearer."""
        self.records.append(record)
        if record["type"] == "decision":
            seen = None
            if self.classifier is not None:
                seen, self.classifier.seen = self.classifier.seen, None
            off_s = abs(float(record["t_s"]) - self._at_s)
            if off_s < self.off_s:
                self.off_s, self.nearest, self.seen = off_s, record, seen
        return super().put(record, sensor, waits=waits)


def moment_of(path: Path, at_s: float, config: Config) -> Moment:
    """Return the decision that ends nearest to `at_s` of a recording; or UsageError."""
    past_s = max(_PAST_S, config.decision.hop_s)
    kept = _Kept(at_s)
    with closing(replay(kept, replaying(config, path, "null"), kept.watch)) as times_s:
        next((t_s for t_s in times_s if t_s >= at_s + 2 * past_s), None)
    decisions = [r for r in kept.records if r["type"] == "decision"]
    if not decisions:
        raise UsageError(f"--at {at_s:g}: {path} has no decision before {at_s + past_s:g} s")
    if kept.off_s > 2 * past_s:
        first, last = decisions[0]["t_s"], decisions[-1]["t_s"]
        raise UsageError(f"--at {at_s:g}: {path} has decisions from {first:g} to {last:g} s")
    before = [r for r in decisions if r["seq"] <= kept.nearest["seq"]]
    hello = next(r for r in kept.records if r["type"] == "hello")
    # The events as they stood then, the last phase of each.
    then = (r for r in kept.records if r["type"] == "event" and r["t_s"] <= kept.nearest["t_s"])
    told = explain(before, hello, config, list({r["id"]: r for r in then}.values()))
    return Moment(path, hello, before, told, kept.classifier, kept.seen)
