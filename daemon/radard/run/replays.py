"""Recordings to records: each is replayed by the service's own code, several at the same time.

A recording takes the way of ``radard --port replay:FILE -o json:RECORDS``, in a process of its
own, so its decisions and events are those of the daemon.
"""

import json
import multiprocessing
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from radard.config.config import Config
from radard.errors import RadardError
from radard.outputs.fanout import Outputs
from radard.outputs.records import Record
from radard.pipeline import Pipeline
from radard.run.pool import WorkerPool
from radard.run.sensor import RunOptions, Sensor
from x2radar.errors import X2RadarError
from x2radar.interrupts import without_interrupts
from x2radar.ports import named_port
from x2radar.recording.registry import open_recording

_LOOK_S = 0.2  # so often processes of the pool are looked at
_NOTE_S = 5.0  # of a stream, after which a process notes how far it is
_progress: Any = None  # in a process of the pool: seconds that are done of each recording

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
    with TemporaryDirectory(prefix="radard-detect-") as folder:
        todo = [
            (config, path, Path(folder) / f"{number}.jsonl", number)
            for number, path in enumerate(paths)
        ]
        for done in _in_turn(todo, tell) if jobs == 1 else _at_once(todo, jobs, tell):
            yield done
            done.records.unlink(missing_ok=True)


_Job = tuple[Config, Path, Path, int]


def _in_turn(todo: Sequence[_Job], tell: Tell) -> Iterator[Judged]:
    for number, job in enumerate(todo):

        def note(share: float, number: int = number) -> None:
            tell((number + share) / len(todo), number)

        yield _judge(job, note)


def _at_once(todo: Sequence[_Job], jobs: int, tell: Tell) -> Iterator[Judged]:
    context = multiprocessing.get_context("spawn")
    # And whether all shall stop, behind them.
    shares = context.Array("d", len(todo) + 1, lock=False)
    pool = ProcessPoolExecutor(
        min(jobs, len(todo)), context, initializer=_take_progress, initargs=(shares,)
    )
    try:
        with without_interrupts():
            futures = [pool.submit(_judge_in_pool, job) for job in todo]
        for future in futures:
            while not future.done():
                time.sleep(_LOOK_S)
                tell(sum(shares[:-1]) / len(todo), sum(each.done() for each in futures))
            yield future.result()
    except BrokenProcessPool as err:
        msg = "a process ended in the middle of its work, perhaps for memory: try --jobs 1"
        raise RadardError(msg) from err
    finally:
        shares[-1] = 1.0
        pool.shutdown(cancel_futures=True)


def _take_progress(shares: Any) -> None:
    global _progress  # noqa: PLW0603 - how a pool's initializer hands something over
    _progress = shares


def _judge_in_pool(job: _Job) -> Judged:
    def note(share: float) -> None:
        _progress[job[3]] = share
        if _progress[-1]:
            raise KeyboardInterrupt

    return _judge(job, note)


def _judge(job: _Job, note: Callable[[float], None]) -> Judged:
    config, path, records, _ = job
    outputs, noted_s = Outputs(stdout_is_terminal=False), 0.0
    try:
        with open_recording(path) as recording:
            started_utc = recording.started_utc
            length_s = recording.n_frames / recording.stream.frame_rate_hz
        for t_s in replay(outputs, replaying(config, path, f"json:{records}")):
            if t_s - noted_s >= _NOTE_S:
                noted_s = t_s
                note(min(1.0, t_s / length_s))
        return Judged(path, records, started_utc)
    except (RadardError, X2RadarError) as err:
        return Judged(path, records, "", str(err), err.exit_code)
    finally:
        note(1.0)


def replay(
    outputs: Outputs, config: Config, prepare: Callable[[Pipeline], object] = lambda _made: None
) -> Generator[float]:
    """Replay into outputs; yield every frame's seconds. `prepare` is given the pipeline first."""
    sensor = Sensor(config, RunOptions(), outputs, WorkerPool())
    outputs.add(sensor)
    opened = sensor.open(lambda _kind, _reason: None)
    try:
        outputs.open(config, can_wait=True)
        prepare(opened.pipeline)
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


def replaying(config: Config, path: Path, *output: str) -> Config:
    """Return a configuration that replays a recording as fast as can be."""
    port = named_port("replay", path)
    sensor = config.sensor.model_copy(update={"port": port, "speed": "max"})
    return config.model_copy(update={"sensor": sensor, "sensors": {}, "output": output})
