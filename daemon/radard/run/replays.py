"""Recordings to records, several at the same time; and what was decided at one moment of one.

A recording takes the way of ``radard --port replay:FILE -o json:RECORDS``, one of several in a
process of the pool, so its decisions and events are those of the daemon.
"""

import json
import math
import multiprocessing
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from radard.alarm.explain import explain
from radard.config.config import Config
from radard.errors import RadardError, UsageError
from radard.judge.classifier import Classifier, Seen
from radard.judge.features import FeatureSettings
from radard.outputs.fanout import Outputs
from radard.outputs.records import Record
from radard.pipeline import Pipeline
from radard.run.pool import WorkerPool
from radard.run.sensor import RunOptions, Sensor
from x2radar.errors import X2RadarError
from x2radar.interrupts import without_interrupts
from x2radar.ports import named_port
from x2radar.recording.registry import open_recording

_LOOK_S = 0.2  # so often those of the pool are looked at
_NOTE_S = 5.0  # of a stream, after which one of them notes how far it is
_PAST_S = 1.0  # so late a window may end behind the moment asked for
_progress: Any = None  # for those of the pool: the share that is done of each recording

Tell = Callable[[float, int], None]  # the share that is done, and how many recordings are


@dataclass(frozen=True, slots=True)
class Judged:
    """Decisions or events of one recording; `fault` is empty if all went well."""

    path: Path
    records: Path
    started_utc: str = ""
    fault: str = ""
    exit_code: int = 0

    def read(self) -> Iterator[Record]:
        """Yield the records, `hello` first."""
        with self.records.open(encoding="utf-8") as file:
            yield from map(json.loads, file)


def judge_all(
    paths: Sequence[Path], config: Config, *, jobs: int, tell: Tell = lambda _share, _n: None
) -> Iterator[Judged]:
    """Judge recordings; yield what became of each, in the order of `paths`."""
    context = multiprocessing.get_context("spawn")
    # And whether all shall stop, behind them.
    shares = context.Array("d", len(paths) + 1, lock=False)
    pool: Executor
    if jobs == 1:
        pool = ThreadPoolExecutor(1, "judge", _take_progress, (shares,))
    else:
        pool = ProcessPoolExecutor(min(jobs, len(paths)), context, _take_progress, (shares,))
    with TemporaryDirectory(prefix="radard-detect-") as folder:
        try:
            with without_interrupts():
                futures = [
                    pool.submit(_judge, config, path, Path(folder) / f"{number}.jsonl", number)
                    for number, path in enumerate(paths)
                ]
            for future in futures:
                while not wait([future], _LOOK_S).done:
                    tell(sum(shares[:-1]) / len(paths), sum(each.done() for each in futures))
                done = future.result()
                yield done
                done.records.unlink(missing_ok=True)
        except BrokenProcessPool as err:
            msg = "a process ended in the middle of its work, perhaps for memory: try --jobs 1"
            raise RadardError(msg) from err
        finally:
            shares[-1] = 1.0
            pool.shutdown(cancel_futures=True)


def _take_progress(shares: Any) -> None:
    global _progress  # noqa: PLW0603 - how a pool's initializer hands something over
    _progress = shares


def _judge(config: Config, path: Path, records: Path, number: int) -> Judged:
    outputs, noted_s = Outputs(stdout_is_terminal=False), 0.0
    try:
        with open_recording(path) as recording:
            started_utc = recording.started_utc
            length_s = recording.n_frames / recording.stream.frame_rate_hz
        for t_s in replay(path, config, outputs, f"json:{records}"):
            if t_s - noted_s >= _NOTE_S:
                noted_s = t_s
                _progress[number] = min(1.0, t_s / length_s)
                if _progress[-1]:
                    raise KeyboardInterrupt
        return Judged(path, records, started_utc)
    except (RadardError, X2RadarError) as err:
        return Judged(path, records, "", str(err), err.exit_code)
    finally:
        _progress[number] = 1.0


def replay(
    path: Path,
    config: Config,
    outputs: Outputs,
    output: str,
    watch: Callable[[Pipeline], object] = lambda _pipeline: None,
) -> Generator[float]:
    """Replay a recording as fast as can be; yield every frame's seconds, after a first `watch`."""
    port = named_port("replay", path)
    of_sensor = config.sensor.model_copy(update={"port": port, "speed": "max"})
    about = {"sensor": of_sensor, "sensors": {}, "output": (output,)}
    config = config.model_copy(update=about)
    sensor = Sensor(config, RunOptions(), outputs, WorkerPool())
    outputs.add(sensor)
    opened = sensor.open(lambda _kind, _reason: None)
    try:
        outputs.open(config, can_wait=True)
        watch(opened.pipeline)
        worker = sensor.make_worker(opened)
        worker.begin()
        first, rate_hz = None, opened.source.stream.frame_rate_hz
        for frame in opened.source.frames():
            first = frame.index if first is None else first
            for item in worker.ring.items(frame):
                worker.handle(item)
            yield (frame.index - first) / rate_hz
    finally:
        opened.close()
        outputs.close()


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


class _Kept(Outputs):
    """Keeps the records of a replay, and what the network saw nearest to some time."""

    pipeline: Pipeline  # that decides

    def __init__(self, at_s: float) -> None:
        super().__init__(stdout_is_terminal=False)
        self._at_s = at_s
        self.records: list[Record] = []
        self.nearest: Record = {}
        self.off_s = math.inf  # how far that is from the time
        self.seen: Seen | None = None

    def watch(self, pipeline: Pipeline) -> None:
        self.pipeline = pipeline

    def put(self, record: Record, sensor: str | None = None, *, waits: bool = False) -> bool:
        self.records.append(record)
        if record["type"] == "decision":
            off_s = abs(float(record["t_s"]) - self._at_s)
            if off_s < self.off_s:
                self.off_s, self.nearest, self.seen = off_s, record, self.pipeline.seen
        return super().put(record, sensor, waits=waits)


def moment_of(path: Path, at_s: float, config: Config) -> Moment:
    """Return the decision that ends nearest to `at_s` of a recording; or UsageError."""
    past_s = max(_PAST_S, config.decision.hop_s)
    kept = _Kept(at_s)
    with closing(replay(path, config, kept, "null", kept.watch)) as times_s:
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
    return Moment(path, hello, before, told, kept.pipeline.classifier, kept.seen)
