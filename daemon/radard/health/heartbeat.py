"""Heartbeat: a thread that shows the rest of the world whether the daemon lives.

It writes a status file for every sensor and feeds systemd's watchdog, and it does the latter
only while `Health` allows it and the main thread has been heard. It has no opinion of its own.
A status file is how `radard health` knows, from outside and without HTTP: a JSON object in the
runtime directory that counts only while it is fresh, by the clock of all processes of one boot.
"""

import contextlib
import json
import logging
import os
import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from radard.health.health import Health, Status, may_feed_all, overall
from x2radar.atomic import write_atomically

log = logging.getLogger("radard")
_EVERY_S = 1.0
STALE_S = 10.0  # ten beats
_MAIN_LATE_S = 5.0  # the main thread comes by once a second


class Notifier:
    """Send messages to the service manager that `environ` names, if there is one."""

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        name = environ.get("NOTIFY_SOCKET", "")
        self._address = f"\0{name[1:]}" if name.startswith("@") else name
        usec = environ.get("WATCHDOG_USEC", "")
        mine = environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.is_watching = usec.isdecimal() and mine  # whether the manager wants to be fed

    def send(self, *lines: str) -> None:
        """Send lines as one message; a manager that does not listen is no fault of ours."""
        if not self._address:
            return
        with (
            contextlib.suppress(OSError),
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as out,
        ):
            # A full queue must not stop the supervisor.
            out.setblocking(False)
            out.sendto("\n".join(lines).encode(), self._address)

    def ready(self, status: str) -> None:
        """Say that start or reload is over."""
        self.send("READY=1", f"STATUS={status}")

    def reloading(self) -> None:
        """Say that a reload begins; `ready` ends it."""
        self.send("RELOADING=1", f"MONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def feed(self, status: str) -> None:
        """Feed the watchdog, if there is one; to be called much more often than it asks for."""
        if self.is_watching:
            self.send("WATCHDOG=1", f"STATUS={status}")


@dataclass(slots=True)
class Watched:
    """A sensor whose health every beat reports, and where its status goes."""

    name: str
    health: Health  # asked at every beat
    path: Path | None  # the status file; None when another process has it
    panel: Callable[[], Mapping[str, Any]]  # further content: how it is armed, what it sees
    is_failing: bool = False  # whether the last status could not be written


class Heartbeat:
    """Beat until stopped, for all sensors of the process."""

    def __init__(self, notifier: Notifier) -> None:
        self._watched: Sequence[Watched] = ()
        self._notifier = notifier
        self._written: set[Path] = set()
        self._main_s: float | None = None
        self._is_ready = False
        self._halt = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)

    def start(self) -> None:
        """Begin, once."""
        if self._thread.ident is None:
            self._thread.start()

    def add(self, watched: Watched) -> None:
        """Show another sensor; another radard that reports as the same keeps its status file."""
        self._watched = [*self._watched, watched]

    def remove(self, name: str) -> None:
        """Show a sensor no more; the next beat takes its status file away."""
        self._watched = [each for each in self._watched if each.name != name]

    @property
    def status(self) -> Status:
        """What holds for all sensors together."""
        return overall({each.name: each.health for each in self._watched})

    def main_is_alive(self) -> None:
        """Note that the main thread came by; from the first time on it must, again and again."""
        self._main_s = time.monotonic()

    def stop(self) -> None:
        """Report shutdown and stop; no-op if not started."""
        if self._thread.ident is None:
            return
        self._halt.set()
        self._thread.join(1.0)
        self._notifier.send("STOPPING=1", f"STATUS={self.status.reason}")
        self._write()

    def _run(self) -> None:
        while not self._halt.wait(_EVERY_S):
            self.beat()

    def beat(self) -> None:
        """Write the status files; feed the watchdog if that is right."""
        self._write()
        is_late = self._main_s is not None and time.monotonic() - self._main_s > _MAIN_LATE_S
        if is_late or not may_feed_all(each.health for each in self._watched):
            return
        text = str(self.status)
        if not self._is_ready:
            # Ready means: the first decision is there, or there is nothing to decide on.
            self._is_ready = True
            self._notifier.ready(text)
        self._notifier.feed(text)

    def _write(self) -> None:
        # One thread writes and unlinks: a file that is taken away cannot be written once more.
        watched = self._watched
        for path in self._written - {each.path for each in watched}:
            with contextlib.suppress(OSError):
                path.unlink()
            self._written.discard(path)
        for each in watched:
            if each.path not in self._written:
                _leave_to_other(each)
            if each.path is None:
                continue
            self._written.add(each.path)
            try:
                write_status(each.path, each.health.status, each.panel())
            except OSError as err:
                # Once; the next beat tries again, because a full disk is not full for ever.
                if not each.is_failing:
                    log.warning("%s: cannot write the status: %s", each.path, err.strerror or err)
                each.is_failing = True
            else:
                each.is_failing = False


def _leave_to_other(each: Watched) -> None:
    if each.path is None:
        return
    report = read_status(each.path, stale_s=3.0)
    pid = report.content.get("pid")
    if not report.is_healthy or not isinstance(pid, int) or pid == os.getpid():
        return
    # Another user's may not be told anything.
    with contextlib.suppress(PermissionError):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return
    log.warning("%s belongs to process %s; none is written", each.path, pid)
    each.path = None


@dataclass(frozen=True, slots=True)
class StatusReport:
    """What a status file says: whether all is well, one line for people, all of it."""

    is_healthy: bool
    line: str
    content: dict[str, Any]


def status_path(folder: Path, sensor: str) -> Path:
    """Return the status file of a sensor."""
    return folder / f"{sensor}.status.json"


def write_status(path: Path, status: Status, more: Mapping[str, Any]) -> None:
    """Write the file, for everybody who can see the folder to read; raises OSError."""
    own = {"pid": os.getpid(), "t_mono_s": round(time.monotonic(), 3)}
    write_atomically(path, json.dumps({**asdict(status), **own, **more}) + "\n", sync=False)


def read_status(path: Path, *, stale_s: float = STALE_S) -> StatusReport:
    """Read a status file; whatever is wrong with it is an unhealthy report, never an error."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        status = Status(content["state"], content["reason"])
        age_s = time.monotonic() - float(content["t_mono_s"])
    except FileNotFoundError:
        return StatusReport(False, f"no radard runs here: no {path}", {})
    except (OSError, ValueError, KeyError, TypeError) as err:
        return StatusReport(False, f"{path}: cannot be read ({err})", {})
    if not age_s >= -1:
        return StatusReport(False, f"{path}: left over from before the last boot", content)
    if age_s > stale_s and status.state != "offline":
        return StatusReport(False, f"stuck or killed: silent for {age_s:.0f} s", content)
    return StatusReport(status.is_well, str(status), content)
