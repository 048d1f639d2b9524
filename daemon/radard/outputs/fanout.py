"""Outputs: all sinks of a process, opened, written to and reopened together.

All sensors share them, but for MQTT, where each is a client with a last will of its own. A sink
that needs more than records has a method `attach(host)` and gets every sensor's `Host`.
"""

import contextlib
import logging
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from radard.config.config import Config
from radard.config.credentials import redact
from radard.config.directories import lock_again, log_path
from radard.config.sink_table import SinkOptions, find_row
from radard.errors import UsageError
from radard.log import EventLog
from radard.outputs.base import Host, Sink, SinkContext
from radard.outputs.records import Record
from radard.outputs.registry import check_output, close_sinks, make_output, start_sink
from radard.outputs.thread_sink import RecordQueue
from x2radar.errors import BriefError

log = logging.getLogger("radard")
_RETRY_S = 10.0  # how soon an output is tried again that could not be opened
_LABELS = "labels_file"
_LOCK_S = 1.0  # a sink takes far less for a record; a thread that holds the lock for longer hangs


@dataclass(slots=True, eq=False)
class _Open:
    """An output, and what is `held` until there is a sink for it, behind `after`; its `fault`.

    `read` is what it read when it was opened, see `_read_by`. `is_left`: its own sensor has gone,
    and one of that name may have come.
    """

    name: str
    sensor: str | None
    read: list[object] = field(default_factory=list)
    sink: Sink | None = None
    held: RecordQueue | None = None
    fault: str = ""
    after: int | None = None
    is_left: bool = False

    def write(self, record: Record) -> None:
        if self.held is not None:
            self.held.put(record)
        elif self.sink is not None:
            self.sink.write(record)


class Outputs:
    """The sinks of a process, for the sensors that are added to it."""

    def __init__(self, *, stdout_is_terminal: bool) -> None:
        self._hosts: dict[str, Host] = {}
        self._stdout_is_terminal = stdout_is_terminal
        self._open: list[_Open] = []
        self.is_open = False  # whether `open` was called with success
        self.can_wait = False  # whether the streams wait for files and stdout, see `open`
        self._config = Config()
        self._hellos: Sequence[Record] = ()
        self.log = EventLog(None)  # has every event before any output; from `open` on, the file's
        self._retry_s = 0.0
        self._lock = threading.Lock()

    def add(self, host: Host) -> None:
        """Take another sensor; outputs of its own are opened by `open` or `reload`."""
        # Not changed in place: other threads may be looking through it.
        self._hosts = {**self._hosts, host.sensor: host}
        for of, sink in self.sinks:
            if of is None:
                getattr(sink, "attach", lambda _host: None)(host)

    def remove(self, sensor: str) -> None:
        """Forget a sensor; its own outputs are closed by `reload`."""
        self._hosts = {name: host for name, host in self._hosts.items() if name != sensor}
        for each in self._open:
            each.is_left |= each.sensor == sensor
        for _, sink in self.sinks:
            getattr(sink, "detach", lambda _sensor: None)(sensor)

    @property
    def sinks(self) -> list[tuple[str | None, Sink]]:
        """All sinks, each with its sensor or None if it gets all records; for any thread."""
        return [(each.sensor, each.sink) for each in self._open if each.sink is not None]

    @property
    def faults(self) -> dict[tuple[str | None, str], str]:
        """Why outputs cannot be opened as a reload asked for, by sensor and name; see `retry`."""
        faults = {
            (each.sensor, each.sink.name if each.sink else redact(each.name)): each.fault
            for each in self._open
            if each.fault
        }
        return {**faults, **({(None, "log"): why} if (why := self.log.fault) else {})}

    def open(self, config: Config, *, can_wait: bool = False) -> None:
        """Open what -o/--output names, once, all or none; `can_wait` is that of `SinkContext`."""
        if self.is_open:
            return
        wanted = self._wanted(config)
        meant = [self._meant_by(name) for name, _ in wanted]
        for name in meant:
            check_output(name)
        if sum(name in {"json", "table"} for name in meant) > 1:
            raise UsageError("--output: json and table both want stdout; give one of them a file")
        self.can_wait, self._config = can_wait, config
        # At full speed nothing is left for the next run but how the sensor is armed.
        path, most = log_path(config), config.log.max_events
        self.log = EventLog(path, max_events=most, keeps_events=not can_wait, lock=lock_again)
        try:
            for name, sensor in wanted:
                read, sink = _read_by(name, config), self._make(name, sensor)
                self._open.append(_Open(name, sensor, read, sink))
            for sensor, sink in self.sinks:
                self._start(sink, sensor)
        except BaseException:
            close_sinks([sink for _, sink in self.sinks])
            self._open = []
            self.log.close()
            raise
        self.is_open = True

    def put(self, record: Record, sensor: str | None = None, *, waits: bool = False) -> bool:
        """Hand a sensor's record to every sink; False if another thread hangs in one."""
        if record["type"] == "event":
            self.log.append(record)
        wait_s = -1 if waits and self.can_wait else _LOCK_S
        if is_free := self._lock.acquire(timeout=wait_s):
            try:
                for each in self._open:
                    if each.sensor in {None, sensor}:
                        each.write(record)
            finally:
                self._lock.release()
        return is_free

    def reload(self, config: Config, hellos: Sequence[Record]) -> None:
        """Open new outputs, close removed ones, reopen those whose options changed.

        All others, and stdout, go on as they are. A sink goes on until the one that replaces it
        can be opened, and records that come in between wait for that. What cannot be opened is
        logged, is among the `faults` and is tried again by `retry`. New sinks get the `hellos` of
        all sensors first.
        """
        self._config, self._hellos = config, hellos
        wanted = self._wanted(config)
        with self._lock:
            known = {(each.name, each.sensor): each for each in self._open}
            gone = [each for key, each in known.items() if key not in wanted]
            self._open = [
                known.get(key) or _Open(*key, held=RecordQueue(), after=self.log.told)
                for key in wanted
            ]
        # Not under the lock: an output may take a moment to end, and the workers must not wait.
        close_sinks([each.sink for each in gone if each.sink is not None])
        for each in gone:
            self._forget(each.sink)
        self.log.max_events = config.log.max_events
        outdated = [
            each
            for each in self._open
            if each.sink is None or each.is_left or each.read != _read_by(each.name, config)
        ]
        for each in self._open:
            each.fault = ""
            if each not in outdated and each.name.startswith("json:"):
                _write_hellos(each, hellos)
        self._reopen(outdated)
        self._retry_s = time.monotonic() + _RETRY_S

    def retry(self) -> None:
        """Try outputs again that could not be opened; to be called now and then."""
        if time.monotonic() >= self._retry_s:
            self._reopen([each for each in self._open if each.fault])
            self._retry_s = time.monotonic() + _RETRY_S

    def close(self) -> None:
        """Close all sinks; log what goes wrong."""
        close_sinks([sink for _, sink in self.sinks])
        self.log.close()

    def _wanted(self, config: Config) -> list[tuple[str, str | None]]:
        """Return every output, with a sensor where each has its own."""
        found: list[tuple[str, str | None]] = []
        # Named twice it is one: two clients of one name would throw each other out.
        for name in dict.fromkeys(config.output or ("",)):
            is_apart = config.is_one_of_several and (row := find_row(name)) and row.is_per_sensor
            found += [(name, sensor) for sensor in (self._hosts if is_apart else (None,))]
        return found

    def _reopen(self, outdated: Sequence[_Open]) -> None:
        """Replace sinks by ones of the options that hold now, or note why that cannot be."""
        made = []
        for each in outdated:
            read = _read_by(each.name, self._config)
            try:
                made.append((each, read, self._make(each.name, each.sensor, each.after)))
            except (BriefError, OSError) as err:
                why = " ".join(str(err).split())
                if why != each.fault:
                    log.warning("reload: %s", why)
                each.fault = why
        with self._lock:
            for each, _, _ in made:
                each.held = each.held or RecordQueue()
        # All at once: those that hang take the time of one, as nobody supervises meanwhile.
        close_sinks([each.sink for each, _, _ in made if each.sink is not None])
        for each, read, sink in made:
            before = each.sink
            self._start(sink, each.sensor)
            self._forget(before, heir=sink)
            with self._lock:
                held, each.held = each.held or RecordQueue(), None
                each.sink, each.read, each.fault, each.is_left = sink, read, "", False
                _write_hellos(each, self._hellos)
                while (record := held.take(0)) is not None:
                    sink.write(record)

    def _forget(self, sink: Sink | None, heir: Sink | None = None) -> None:
        """Take away a sink's cursor, unless an `heir` goes on with it."""
        cursors = (getattr(each, "cursor", None) for each in (sink, heir))
        name, kept = (getattr(cursor, "name", None) for cursor in cursors)
        if name not in {None, kept}:
            self.log.forget(name)

    def _meant_by(self, name: str) -> str:
        return name or ("table" if self._stdout_is_terminal else "json")

    def _start(self, sink: Sink, sensor: str | None) -> None:
        start_sink(sink)
        for host in self._hosts.values() if sensor is None else [self._hosts[sensor]]:
            getattr(sink, "attach", lambda _host: None)(host)

    def _make(self, name: str, sensor: str | None, after: int | None = None) -> Sink:
        """Return the sink of an output, of the options that hold, to be started."""
        # Of several, sensors come and go while a sink that all share stays.
        is_shared = sensor is None and self._config.is_one_of_several
        host = None if is_shared else self._hosts[sensor or next(iter(self._hosts))]
        context = SinkContext(
            sensor="radard" if host is None else host.sensor,
            host=host,
            is_one_of_several=sensor is not None,
            can_wait=self.can_wait,
            mark="" if host is None else host.mark(),
            log=self.log,
            after=after,
        )
        return make_output(self._meant_by(name), self._config, context)


def _read_by(name: str, options: SinkOptions) -> list[object]:
    """Return what an output reads when it is opened: options, and which files those name."""
    row = find_row(name)
    # A plug-in may read any of them; no output at all is stdout.
    of_plugin = tuple(SinkOptions.model_fields) if name else ()
    sections = [getattr(options, each) for each in (row.sections if row else of_plugin)]
    # Labels are written, by the page.
    files = [v for section in sections for k, v in section if k.endswith("_file") and k != _LABELS]
    if (rest := name.partition(":")[2]).startswith("@"):
        files.append(Path(rest[1:]))
    return [*sections, *(_version_of(path) for path in files if path is not None)]


def _version_of(path: Path) -> tuple[int, ...]:
    """Return what differs once a file is another, or gone."""
    with contextlib.suppress(OSError):
        about = path.stat()
        return about.st_ino, about.st_size, about.st_mtime_ns
    return ()


def _write_hellos(each: _Open, hellos: Sequence[Record]) -> None:
    for hello in hellos:
        if each.sensor in {None, hello.get("sensor")}:
            each.write(hello)
