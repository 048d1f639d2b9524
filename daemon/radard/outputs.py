"""Outputs: all sinks of a run, opened, written to and reopened together.

A sink that wants more than records, MQTT or the dashboard, has a method `attach(host)` and
gets the run's `Host`: the health and panel it reports, the command it passes on.
"""

import logging
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from radard.config import Config
from radard.directories import outbox_dir
from radard.errors import RadardError
from radard.health import Health
from radard.output import Record
from radard.playback import Playback
from radard.ring import FrameRing
from radard.sinks import close_sinks, open_sinks
from radard.sinks.base import Sink, SinkContext
from radard.sinks.options import SinkOptions

log = logging.getLogger("radard")
COMMANDS = ("arm", "disarm", "ack", "calibrate")
_PATIENCE_S = 1.0
_STDOUT = ("", "json", "table")


@dataclass(frozen=True, slots=True)
class Host:
    """What a run offers to its sinks; everything here may be used from any thread.

    Attributes
    ----------
    health : Health
        To be asked for its status whenever one is shown.
    panel : callable
        Returns a mapping: armed, panel (its state, see `radard.alarm`), alarm_id, open (reasons
        of events that are on, by kind), seq, t_s, gate, label.
    command : callable
        Takes one of `COMMANDS`; raises ValueError on anything else. Never waits.
    config : callable
        Returns the configuration that holds.
    ring : callable
        Returns the ring of the stream, None before there is one.
    playback : callable
        Returns the controls of a replay, None for anything else.
    sinks : callable
        Returns all sinks of the run.
    """

    health: Health
    panel: Callable[[], Mapping[str, Any]]
    command: Callable[[str], None]
    config: Callable[[], Config] = Config
    ring: Callable[[], FrameRing | None] = lambda: None
    playback: Callable[[], Playback | None] = lambda: None
    sinks: Callable[[], Sequence[Sink]] = tuple


class Outputs:
    """The sinks of a run.

    Parameters
    ----------
    host : Host
        For sinks that want it.
    stdout_is_terminal : bool
        Whether a person reads stdout.
    """

    def __init__(self, host: Host, *, stdout_is_terminal: bool) -> None:
        self._host = replace(host, sinks=lambda: [sink for _, sink in self._sinks])
        self._stdout_is_terminal = stdout_is_terminal
        self._sinks: list[tuple[str, Sink]] = []
        self._is_open = self._can_wait = False
        self._options = SinkOptions()
        self._lock = threading.Lock()

    @property
    def is_open(self) -> bool:
        """Whether `open` was called with success."""
        return self._is_open

    def open(self, config: Config, *, can_wait: bool = False) -> None:
        """Open what -o/--output names, once; raises UsageError or OutputError, see open_sinks.

        Parameters
        ----------
        config : Config
            Outputs and their options.
        can_wait : bool
            The stream can wait for files and stdout, see `SinkContext`.
        """
        if self._is_open:
            return
        self._can_wait, self._options = can_wait, _options_of(config)
        sinks = self._opened(config.output, config)
        names = list(config.output) or [""]
        self._sinks = list(zip(names, sinks, strict=True))
        self._is_open = True

    def put(self, record: Record) -> bool:
        """Hand a record to every sink; return False if another thread is stuck in one.

        Raises
        ------
        OutputError, BrokenPipeError
            If a sink cannot keep it.
        """
        if not self._lock.acquire(timeout=_PATIENCE_S):
            return False
        try:
            for _, sink in self._sinks:
                sink.write(record)
        finally:
            self._lock.release()
        return True

    def reload(self, config: Config, hello: Record) -> None:
        """Open new outputs, close those that are gone, reopen files, as log rotation wants it.

        All but stdout are reopened when their options have changed. A sink that cannot be
        opened is said and left out: the others matter more.
        """
        wanted = list(config.output) or [""]
        options = _options_of(config)
        is_same = options == self._options
        with self._lock:
            kept: list[tuple[str, Sink]] = []
            gone: list[tuple[str, Sink]] = []
            for name, sink in self._sinks:
                stays = name in _STDOUT or (is_same and not name.startswith("json:"))
                (kept if name in wanted and stays else gone).append((name, sink))
            self._sinks, self._options = kept, options
        # Not under the lock: an outbox may take a moment to end, and the worker must not wait.
        _close(sink for _, sink in gone)
        for name in wanted:
            if name in [known for known, _ in kept]:
                continue
            try:
                (sink,) = self._opened([name] if name else [], config)
                sink.write(hello)
            except (RadardError, OSError) as err:
                log.warning("reload: %s", err)
                continue
            with self._lock:
                self._sinks.append((name, sink))

    def close(self) -> None:
        """Close all sinks; what one of them still has to say does not keep the others open."""
        _close(sink for _, sink in self._sinks)

    def _opened(self, outputs: Sequence[str], config: Config) -> list[Sink]:
        host = self._host
        context = SinkContext(
            sensor=config.sensor.name,
            state_dir=None if self._can_wait else outbox_dir(config),
            can_wait=self._can_wait,
            command=host.command,
            panel=host.panel,
            health=lambda: host.health.status,
        )
        sinks = open_sinks(
            outputs,
            stdout_is_terminal=self._stdout_is_terminal,
            options=config,
            context=context,
        )
        for sink in sinks:
            attach = getattr(sink, "attach", None)
            if attach is not None:
                attach(host)
        return sinks


def _options_of(config: Config) -> SinkOptions:
    return SinkOptions(**{name: getattr(config, name) for name in SinkOptions.model_fields})


def _close(sinks: Iterable[Sink]) -> None:
    for err in close_sinks(list(sinks)):
        if not isinstance(err, BrokenPipeError):
            log.warning("%s", err)
