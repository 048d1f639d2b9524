"""ClipKeeper: holds the last frames, and makes a clip of those around an alarm.

The reader pushes frames, the worker says which belong to a clip, by decisions alone, and a thread
of its own writes them. The first is the first of a dwell, so a replay of the clip cuts the same
dwells.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radard.clips.room import date_last, limit_size, prepare_folder
from radard.config.sections import ClipsSection
from radard.errors import OutputError
from x2radar import wall_clock
from x2radar.frame import Frame, StreamInfo

if TYPE_CHECKING:
    from radard.clips.clip_file import ClipFile

log = logging.getLogger("radard")
_SLACK_S = 4.0  # held beyond `pre_s`; a decision is never so late
_MAX_JOBS = 200  # that wait for the disk; some minutes
_WAIT_S = 0.5  # as long as an alarm waits for the disk of the event log
_MAX_PAST = 512  # decisions; twice the longest `pre_s`, of the shortest hop


@dataclass(slots=True)
class _Running:
    """The clip that is being made: frames `taken` to `end` are still to come."""

    event: Mapping[str, Any]
    taken: int
    end: int
    seen_s: float
    decisions: list[Mapping[str, Any]]


@dataclass(eq=False)
class ClipKeeper:
    """Make clips in `folder`, of a stream whose dwells have `n_slow` frames."""

    settings: ClipsSection
    folder: Path
    stream: StreamInfo
    n_slow: int
    attributes: Mapping[str, str]  # root attributes of the clips to come; any thread may set them

    def __post_init__(self) -> None:
        self._rate_hz = self.stream.frame_rate_hz
        n_hold = round((self.settings.pre_s + _SLACK_S) * self._rate_hz) + 2 * self.n_slow
        self._held: deque[Frame] = deque(maxlen=n_hold)
        self._lock = threading.Lock()
        self._past: deque[tuple[int, Mapping[str, Any]]] = deque(maxlen=_MAX_PAST)
        self._running: _Running | None = None
        # The interpreter ends only when its jobs are done: it may hold HDF5's lock.
        self._writer = ThreadPoolExecutor(1, "clips")
        self._free_jobs = threading.Semaphore(_MAX_JOBS)
        self._last: Future[None] | None = None
        self._file: ClipFile | None = None  # of the clips' own thread alone
        self._room: Future[None] | None = None  # done once there was an answer
        self.complaint = ""  # why the last clip was not made, or empty; for any thread

    def push(self, frame: Frame) -> None:
        """Hold a frame for a while; called by the reader."""
        with self._lock:
            self._held.append(frame)

    def restart(self) -> None:
        """Note that the stream restarted: no clip begins before this."""
        self._past.clear()

    def on_decision(self, record: Mapping[str, Any], t_s: float) -> None:
        """Take a decision's record and exact time, before the events that it makes."""
        end = round(t_s * self._rate_hz)
        self._past.append((end - self.n_slow, record))
        if self._running is not None:
            self._running.decisions.append(record)
            self._take(self._running, end)

    def begin(self, event: Mapping[str, Any], t_s: float) -> str | None:
        """Begin a clip of an event; return its path, None without room or while one is made.

        Also None while a slow disk has not answered: `named_of` tells the path then.
        """
        if self._running is not None:
            return None
        self._room = room = self._do(self._look_for_room)
        if room is not None and wait([room], _WAIT_S).done and self.complaint:
            return None
        end = round(t_s * self._rate_hz)
        earliest = end - self.n_slow - round(self.settings.pre_s * self._rate_hz)
        past = [item for item in self._past if item[0] >= earliest]
        # An alarm of before a restart begins before there is a dwell.
        first = past[0][0] if past else max(0, end - self.n_slow)
        last = max(end, first + round(self.settings.longest_s * self._rate_hz))
        path = self.folder / f"{event['id']}.h5"
        event = {**event, "clip": str(path)}
        self._running = _Running(event, first, last, t_s, [record for _, record in past])
        began = wall_clock.now() - timedelta(seconds=(end - first) / self._rate_hz)
        self._do(self._open, path, first, wall_clock.utc_text(began), self.attributes)
        self._take(self._running, end, draws=True)
        return self.named_of(event["id"])

    def named_of(self, event_id: str) -> str | None:
        """Return the path of an event's clip while it is made, once there is room for it."""
        running = self._running
        if running is None or running.event["id"] != event_id or self.complaint:
            return None
        is_answered = self._room is not None and self._room.done()
        return str(running.event["clip"]) if is_answered else None

    def after(self, t_s: float, *, is_seen: bool, event: Mapping[str, Any] | None = None) -> None:
        """Note whether somebody is in sight, and what the clip's event has become."""
        running = self._running
        if running is None:
            return
        if event is not None and event["id"] == running.event["id"]:
            # What was told before the disk answered named no clip.
            running.event = {**event, "clip": running.event["clip"]}
        if is_seen:
            running.seen_s = t_s
        if t_s - running.seen_s >= self.settings.post_s or running.taken >= running.end:
            self._finish(running)

    def close(self, timeout_s: float) -> bool:
        """End the clip at hand; return whether all is on the disk."""
        if self._running is not None:
            self._finish(self._running)
        return self._last is None or bool(wait([self._last], timeout_s).done)

    def _look_for_room(self) -> None:
        prepare_folder(self.folder, free_bytes=self.settings.free_mb * 1e6)
        self.complaint = ""

    def _take(self, running: _Running, end: int, *, draws: bool = False) -> None:
        first, last = running.taken, min(end, running.end)
        with self._lock:
            frames = [f for f in self._held if first <= f.index < last]
        running.taken = max(first, last)
        if frames:
            self._do(self._write, frames, draws)

    def _finish(self, running: _Running) -> None:
        self._running = None
        self._do(self._end, running)

    def _do(self, job: Callable[..., object], *given: object) -> Future[None] | None:
        """Let the clips' own thread do a job, behind all others; None where too many wait."""
        if self._free_jobs.acquire(blocking=False):
            self._last = self._writer.submit(self._done, job, *given)
            return self._last
        if not self.complaint:
            of = f"{self._running.event['clip']}: " if self._running else ""
            self._complain(OutputError(f"{of}the disk is too slow, or hangs"))
        return None

    def _done(self, job: Callable[..., object], *given: object) -> None:
        try:
            job(*given)
        except Exception as err:  # noqa: BLE001 - a clip must not cost the others
            self._complain(err)
        finally:
            self._free_jobs.release()

    def _open(self, path: Path, first: int, utc: str, about: Mapping[str, str]) -> None:
        if self.complaint:
            return
        if path.exists():
            # A named simulated stream that begins again has the events and clips of the last time.
            date_last(path)
            return
        # Late, so that a run without alarms never loads h5py.
        from radard.clips.clip_file import ClipFile  # noqa: PLC0415

        self._file = ClipFile(path, self.stream, first, utc, about)

    def _write(self, frames: list[Frame], draws: bool) -> None:
        """Add frames; what is still told of a clip that cannot go on is dropped."""
        file, self._file = self._file, None
        if file is not None:
            file.write(frames)
        self._file = file
        if file is not None and draws:
            file.preview()

    def _end(self, running: _Running) -> None:
        file, self._file = self._file, None
        if file is not None:
            file.finish(running.decisions, running.event)
            limit_size(self.folder, keep_bytes=self.settings.keep_mb * 1e6)
            self.complaint = ""

    def _complain(self, err: Exception) -> None:
        why = err.strerror if isinstance(err, OSError) else None
        self.complaint = f"{self.folder}: {why}" if why else str(err)
        log.warning("clip: %s", self.complaint)
