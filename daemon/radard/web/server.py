"""Limits on connections, as a protocol of uvicorn's; and who holds a port."""

import asyncio
import contextlib
import logging
import socket
from pathlib import Path
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

from radard.web.auth import is_loopback

# A stranger's bytes that are no HTTP would be a line each.
logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
# Limits for a home's browsers and scrapers, not for the internet.
_MAX_CONNECTIONS = 256
_KEPT_FOR_LOOPBACK = 32  # of those; `/healthz` and disarming on this machine always find room
_MAX_OF_ONE_ADDRESS = 64  # a browser opens seven; loopback may stand for a whole proxy
_HEADER_S = 10.0  # for each request's header
_LISTEN = "0A"  # state of a socket in /proc/net/tcp
_SEND_BUFFER = 65_536  # bytes; what a slow page cannot take shall not pile up in the kernel


class Connection(H11Protocol):
    """One connection, closed when a header is late; idle ones give way where there are many."""

    transport: asyncio.Transport | None  # type: ignore[assignment]
    _late: asyncio.TimerHandle | None = None
    since_s = 0.0

    @property
    def is_idle(self) -> bool:
        """Whether no request is being answered."""
        return not self.has_asked or self.cycle.response_complete

    @property
    def has_asked(self) -> bool:
        """Whether a whole header has ever come."""
        return getattr(self, "cycle", None) is not None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection if there is room for it."""
        peer = transport.get_extra_info("peername")
        if not _make_room(self.connections, peer[0] if peer else ""):
            transport.abort()
            return
        super().connection_made(transport)
        if (own := transport.get_extra_info("socket")) is not None:
            own.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self.since_s = self.loop.time()
        self._late = self.loop.call_later(_HEADER_S, self.give_way)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection that has ended."""
        self._stop_timer()
        if self.transport is not None:
            super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take bytes; once a request is being answered, its header has come in time."""
        super().data_received(data)
        # A WebSocket is out of the set: it has a protocol of its own from here on.
        if not self.is_idle or self not in self.connections:
            self.since_s = self.loop.time()
            self._stop_timer()
        elif self._late is None:
            self._late = self.loop.call_later(_HEADER_S, self.give_way)

    def give_way(self) -> None:
        """Abort the connection, to make room for another."""
        self._stop_timer()
        self.connections.discard(self)
        if self.transport is not None:
            self.transport.abort()

    def _stop_timer(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None


def _make_room(connections: set[Any], address: str) -> bool:
    """Return whether one more connection of an address may come; an idle one gives way to it."""
    known = [(each, each.client[0] if each.client else "") for each in connections]
    local = [each for each, at in known if is_loopback(at)]
    strangers = [each for each, at in known if not is_loopback(at)]
    most = _MAX_CONNECTIONS
    if not is_loopback(address):
        own = [each for each, at in known if at == address]
        if len(own) >= _MAX_OF_ONE_ADDRESS:
            return _drop_idle(own)
        local = [each for each in local if not getattr(each, "has_asked", True)]
        most -= _KEPT_FOR_LOOPBACK
    return len(connections) < most or _drop_idle(strangers) or _drop_idle(local)


def _drop_idle(connections: list[Any]) -> bool:
    """Close one of the idle connections; return whether there was one."""
    idle = [each for each in connections if isinstance(each, Connection) and each.is_idle]
    if idle:
        # Those that never asked go first, then the oldest.
        min(idle, key=lambda each: (each.has_asked, each.since_s)).give_way()
    return bool(idle)


def port_holder(port: int) -> str:
    """Return who listens on a TCP port, as 'process 812 (radard)'; empty if not to be seen."""
    wanted = set()
    for table in ("tcp", "tcp6"):
        with contextlib.suppress(OSError):
            for line in Path("/proc/net", table).read_text("ascii").splitlines()[1:]:
                fields = line.split()
                if fields[3] == _LISTEN and int(fields[1].rpartition(":")[2], 16) == port:
                    wanted.add(f"socket:[{fields[9]}]")
    for process in Path("/proc").glob("[0-9]*") if wanted else ():
        # It may have ended since it was listed.
        with contextlib.suppress(OSError):
            if any(str(each.readlink()) in wanted for each in (process / "fd").iterdir()):
                name = (process / "comm").read_text(errors="replace").strip()
                return f"process {process.name} ({name})"
    return ""
