"""Outputs: all sinks of a process, opened, written to and reopened together.

All sensors of a process share them, and every record of several sensors names its sensor;
only MQTT, where a sensor is a client with a last will of its own, has a sink for each. A sink
that needs more than records, such as the dashboard, has a method `attach(host)` and gets the
`Host` of every sensor.
"""

import logging
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from radard.config.config import Config
from radard.config.directories import outbox_dir
from radard.config.sink_table import SinkOptions, find_row
from radard.errors import RadardError
from radard.health.health import Health, overall
from radard.outputs.records import Record
from radard.sinks import close_sinks, open_sinks
from radard.sinks.base import Sink, SinkContext
from radard.stream.playback import Playback
from radard.stream.ring import FrameRing

log = logging.getLogger("radard")
SHARED = "radard"
"""Stands for all sensors of a process, where a sink needs one name."""
_LOCK_S = 1.0
"""Chosen: a sink takes far less for a record; a thread that holds the lock for longer hangs."""


@dataclass(frozen=True, slots=True)
class Host:
    """What a sensor's run offers to its sinks; everything here may be used from any thread.

    Attributes
    ----------
    sensor : str
        Name of the sensor.
    health : Health
        Its status at any moment.
    panel : callable
        Returns a mapping: armed, panel (its state, see `radard.alarm.panel`), alarm_id, open
        (reasons of events that are on, by kind), seq, t_s, gate, label.
    command : callable
        Takes one of `radard.sinks.base.COMMANDS`; raises ValueError on anything else. Never waits.
    config : callable
        Returns the configuration that holds.
    ring : callable
        Returns the ring of the stream, None before there is one.
    playback : callable
        Returns the controls of a replay, None for anything else.
    driver : callable
        Returns what the driver has counted, by the names of `x2radar.RadarStats`.
    sinks : callable
        Returns all sinks of the run.
    reload : callable
        Asks for the configuration to be read again, as SIGHUP does. Never waits.
    """

    sensor: str
    health: Health
    panel: Callable[[], Mapping[str, Any]]
    command: Callable[[str], None]
    config: Callable[[], Config] = Config
    ring: Callable[[], FrameRing | None] = lambda: None
    playback: Callable[[], Playback | None] = lambda: None
    driver: Callable[[], Mapping[str, int]] = dict
    sinks: Callable[[], Sequence[Sink]] = tuple
    reload: Callable[[], None] = lambda: None


@dataclass(slots=True, eq=False)
class _Open:
    """An open output: what -o named, its sensor if only one, and records held while it reopens."""

    name: str
    sensor: str | None
    sink: Sink
    held: list[Record] | None = None

    def write(self, record: Record) -> None:
        if self.held is None:
            self.sink.write(record)
        else:
            self.held.append(record)


class Outputs:
    """The sinks of a process; `hosts` are those of all its sensors."""

    def __init__(self, hosts: Sequence[Host], *, stdout_is_terminal: bool) -> None:
        self._hosts = {
            host.sensor: replace(host, sinks=lambda: [each.sink for each in self._open])
            for host in hosts
        }
        self._stdout_is_terminal = stdout_is_terminal
        self._open: list[_Open] = []
        self._is_open = self._can_wait = False
        self._options = SinkOptions()
        self._lock = threading.Lock()

    @property
    def is_open(self) -> bool:
        """Whether `open` was called with success."""
        return self._is_open

    @property
    def can_wait(self) -> bool:
        """Whether the streams wait for files and stdout, see `open`."""
        return self._can_wait

    @property
    def sinks(self) -> list[tuple[str | None, Sink]]:
        """All sinks, each with its sensor or None if it gets all records; for any thread."""
        return [(each.sensor, each.sink) for each in self._open]

    def open(self, config: Config, *, can_wait: bool = False) -> None:
        """Open what -o/--output names, once; `can_wait` and errors are those of `open_sinks`."""
        if self._is_open:
            return
        self._can_wait, self._options = can_wait, _options_of(config)
        wanted = self._wanted(config)
        shared = [name for name, sensor in wanted if sensor is None]
        # All shared ones in one go: two that want stdout are a fault.
        sinks = iter(self._opened(shared, None, config) if shared else ())
        try:
            for name, sensor in wanted:
                sink = next(sinks) if sensor is None else self._opened([name], sensor, config)[0]
                self._open.append(_Open(name, sensor, sink))
        except BaseException:
            _close([*(each.sink for each in self._open), *sinks])
            self._open = []
            raise
        self._is_open = True

    def put(self, record: Record, sensor: str | None = None, *, waits: bool = False) -> bool:
        """Hand a record to every sink; return False if another thread hangs in one.

        Parameters
        ----------
        record : Record
            Of any type.
        sensor : str or None
            Its sensor; None: the only one.
        waits : bool
            Wait for as long as it takes where streams can wait for a sink.

        Raises
        ------
        OutputError, BrokenPipeError
            If a sink cannot keep it.
        """
        wait_s = -1 if waits and self._can_wait else _LOCK_S
        if not self._lock.acquire(timeout=wait_s):
            return False
        try:
            for each in self._open:
                if each.sensor is None or each.sensor == sensor:
                    each.write(record)
        finally:
            self._lock.release()
        return True

    def reload(self, config: Config, hellos: Sequence[Record]) -> None:
        """Open new outputs, close removed ones, reopen those whose options changed.

        All others, and stdout, go on as they are. Records that come while a sink is being
        reopened wait for it. One that cannot be opened is logged and left out. New sinks get
        the `hellos` of all sensors first.
        """
        wanted = self._wanted(config)
        options = _options_of(config)
        before = self._options
        changed = {
            n for n in SinkOptions.model_fields if getattr(options, n) != getattr(before, n)
        }
        with self._lock:
            gone = [each for each in self._open if (each.name, each.sensor) not in wanted]
            kept = [each for each in self._open if each not in gone]
            again = [each for each in kept if _depends(each.name, changed)]
            for each in again:
                each.held = []
            self._open, self._options = kept, options
        # Not under the lock: an outbox may take a moment to end, and the workers must not wait.
        _close(each.sink for each in (*gone, *again))
        known = [(each.name, each.sensor) for each in kept]
        for each in kept:
            if each in again:
                self._reopen(each, config, hellos)
            elif each.name.startswith("json:"):
                _write_hellos(each, hellos)
        for name, sensor in wanted:
            if (name, sensor) not in known:
                self._add(name, sensor, config, hellos)

    def close(self) -> None:
        """Close all sinks; log what goes wrong."""
        _close(each.sink for each in self._open)

    def _wanted(self, config: Config) -> list[tuple[str, str | None]]:
        """Return every output, with a sensor where each has its own."""
        found: list[tuple[str, str | None]] = []
        for name in config.output or ("",):
            row = find_row(name)
            is_apart = config.is_one_of_several and row is not None and row.is_per_sensor
            found += [(name, sensor) for sensor in (self._hosts if is_apart else (None,))]
        return found

    def _reopen(self, each: _Open, config: Config, hellos: Sequence[Record]) -> None:
        sink = self._try_to_open(each.name, each.sensor, config)
        with self._lock:
            if sink is None:
                self._open = [other for other in self._open if other is not each]
                return
            held, each.held, each.sink = each.held or [], None, sink
            _write_hellos(each, hellos)
            for record in held:
                sink.write(record)

    def _add(
        self, name: str, sensor: str | None, config: Config, hellos: Sequence[Record]
    ) -> None:
        sink = self._try_to_open(name, sensor, config)
        if sink is not None:
            each = _Open(name, sensor, sink)
            with self._lock:
                _write_hellos(each, hellos)
                self._open.append(each)

    def _try_to_open(self, name: str, sensor: str | None, config: Config) -> Sink | None:
        try:
            return self._opened([name], sensor, config)[0]
        except (RadardError, OSError) as err:
            log.warning("reload: %s", err)
            return None

    def _opened(self, outputs: Sequence[str], sensor: str | None, config: Config) -> list[Sink]:
        sinks = open_sinks(
            [name for name in outputs if name],
            stdout_is_terminal=self._stdout_is_terminal,
            options=config,
            context=self._context(sensor, config),
        )
        hosts = self._hosts.values() if sensor is None else [self._hosts[sensor]]
        for sink in sinks:
            attach = getattr(sink, "attach", None)
            if attach is not None:
                for host in hosts:
                    attach(host)
        return sinks

    def _context(self, sensor: str | None, config: Config) -> SinkContext:
        hosts = self._hosts if sensor is None else {sensor: self._hosts[sensor]}
        own = next(iter(hosts.values())) if len(hosts) == 1 else None

        def command(name: str) -> None:
            for host in hosts.values():
                host.command(name)

        def panel() -> Mapping[str, Any]:
            panels = [host.panel() for host in hosts.values()]
            return {"armed": all(each.get("armed", True) for each in panels)}

        return SinkContext(
            sensor=own.sensor if own else SHARED,
            is_one_of_several=config.is_one_of_several,
            state_dir=None if self._can_wait else outbox_dir(config),
            can_wait=self._can_wait,
            command=command,
            panel=own.panel if own else panel,
            health=lambda: overall({name: host.health for name, host in hosts.items()}),
        )


class Feed:
    """Hands on the records of one sensor; the only one is None, and its records do not name it."""

    def __init__(self, outputs: Outputs, sensor: str | None = None) -> None:
        self._outputs = outputs
        self._sensor = sensor

    def put(self, record: Record, *, waits: bool = True) -> bool:
        """Hand on one record, see `Outputs.put`."""
        if self._sensor is not None:
            record = {**record, "sensor": self._sensor}
        return self._outputs.put(record, self._sensor, waits=waits)


def _depends(name: str, changed: set[str]) -> bool:
    """Return whether an output must be reopened when these sections have changed."""
    row = find_row(name)
    if row is not None:
        return bool(changed.intersection(row.sections))
    # A plug-in may read any of them; no output at all is stdout.
    return bool(name and changed)


def _write_hellos(each: _Open, hellos: Sequence[Record]) -> None:
    for hello in hellos:
        if each.sensor in {None, hello.get("sensor")}:
            each.sink.write(hello)


def _options_of(config: Config) -> SinkOptions:
    return SinkOptions(**{name: getattr(config, name) for name in SinkOptions.model_fields})


def _close(sinks: Iterable[Sink]) -> None:
    for err in close_sinks(list(sinks)):
        if not isinstance(err, BrokenPipeError):
            log.warning("%s", err)
