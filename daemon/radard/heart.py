"""Heart: a thread that shows the rest of the world whether the daemon lives.

It writes the status file and feeds systemd's watchdog, and it does the latter only while
`Health` allows it and the main thread has been heard. It has no opinion of its own.
"""

import logging
import os
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from radard.health import Health
from radard.status_file import read_status, write_status
from radard.watchdog import Notifier

log = logging.getLogger("radard")
_EVERY_S = 0.5
_MAIN_LATE_S = 5.0


class Heart:
    """Beat until stopped.

    Parameters
    ----------
    health : Health
        Asked at every beat.
    notifier : Notifier
        systemd, or nobody.
    path : Path
        The status file.
    panel : callable
        Further content of the status file, see `radard.outputs.Host`.
    """

    def __init__(
        self,
        health: Health,
        notifier: Notifier,
        path: Path,
        panel: Callable[[], Mapping[str, Any]],
    ) -> None:
        self._health = health
        self._notifier = notifier
        self._path: Path | None = path
        self._panel = panel
        self._main_s: float | None = None
        self._is_ready = False
        self._halt = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heart", daemon=True)

    def start(self) -> None:
        """Begin, once; another radard that reports as the same sensor keeps its status file."""
        if self._thread.ident is not None:
            return
        if self._path is not None:
            report = read_status(self._path, stale_s=3.0)
            pid = report.content.get("pid")
            if report.content.get("state") != "offline" and _is_other(pid) and report.is_healthy:
                log.warning("%s belongs to process %s; none is written", self._path, pid)
                self._path = None
        self._thread.start()

    def main_is_alive(self) -> None:
        """Note that the main thread came by; from the first time on it must, again and again."""
        self._main_s = time.monotonic()

    def stop(self) -> None:
        """Say the end, and end; nothing if it never began."""
        if self._thread.ident is None:
            return
        self._halt.set()
        self._thread.join(1.0)
        status = self._health.status
        self._notifier.stopping(status.reason)
        self._write()

    def _run(self) -> None:
        while not self._halt.wait(_EVERY_S):
            self.beat()

    def beat(self) -> None:
        """Write the status file; feed the watchdog if that is right."""
        now_s = time.monotonic()
        status = self._health.status
        text = f"{status.state}: {status.reason}" if status.reason else status.state
        self._write()
        is_late = self._main_s is not None and now_s - self._main_s > _MAIN_LATE_S
        if is_late or not self._health.may_feed:
            return
        if not self._is_ready:
            # Ready means: the first decision is there, or there is nothing to decide on.
            self._is_ready = True
            self._notifier.ready(text)
        self._notifier.feed(text, now_s)

    def _write(self) -> None:
        if self._path is None:
            return
        more = {**self._panel(), "decision_age_s": round(self._health.age_s, 1)}
        try:
            write_status(self._path, self._health.status, more)
        except OSError as err:
            log.warning("%s: cannot write the status: %s", self._path, err.strerror or err)
            self._path = None


def _is_other(pid: Any) -> bool:
    if not isinstance(pid, int) or pid == os.getpid():
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
