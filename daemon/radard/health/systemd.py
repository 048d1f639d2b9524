"""systemd's side of being alive: messages to its notification socket, and when to feed.

The protocol (sd_notify(3)) is one datagram of KEY=VALUE lines to the unix socket that
$NOTIFY_SOCKET names; a name that begins with @ lies in the abstract name space.
"""

import contextlib
import logging
import os
import socket
import time
from collections.abc import Mapping

log = logging.getLogger("radard")


class Notifier:
    """Send messages to the service manager that `environ` names, if there is one."""

    def __init__(self, environ: Mapping[str, str] = os.environ) -> None:
        name = environ.get("NOTIFY_SOCKET", "")
        self._address = f"\0{name[1:]}" if name.startswith("@") else name
        usec = environ.get("WATCHDOG_USEC", "")
        mine = environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.every_s = int(usec) / 2e6 if usec.isdecimal() and mine else None
        """Longest time between two `watchdog` messages, in seconds; None if none is wanted."""
        self._fed_s = 0.0

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

    def stopping(self, status: str) -> None:
        """Say that the end has begun."""
        self.send("STOPPING=1", f"STATUS={status}")

    def feed(self, status: str, now_s: float) -> None:
        """Feed the watchdog, four times as often as it must be."""
        if self.every_s is not None and now_s - self._fed_s >= self.every_s / 2:
            self._fed_s = now_s
            self.send("WATCHDOG=1", f"STATUS={status}")
