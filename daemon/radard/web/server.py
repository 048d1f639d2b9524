"""Server: uvicorn in a thread of its own, with limits on connections.

It starts as soon as the port is free: a busy one is logged once and tried again, and the run
goes on without a dashboard meanwhile.
"""

import asyncio
import contextlib
import errno
import logging
import socket
import threading
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from radard.web.auth import is_loopback

log = logging.getLogger("radard")
# A stranger's bytes that are no HTTP would be a line each.
logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
# Limits for a home's browsers and scrapers, not for the internet.
_MAX_CONNECTIONS = 256
_KEPT_FOR_LOOPBACK = 32  # of those; `/healthz` and disarming on this machine always find room
_MAX_OF_ONE_ADDRESS = 64  # a browser opens seven; loopback may stand for a whole proxy
_HEADER_S = 10.0  # for each request's header
_MAX_HEADER, _MAX_MESSAGE = 16_384, 512  # bytes; the longest that a page sends has thirty
_RETRY_S = 5.0
_LISTEN = "0A"  # state of a socket in /proc/net/tcp
_BACKLOG = 128  # connections that wait to be taken
_TOO_MANY = {errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM}
_SAID_S = 60.0  # how often that is said
_LAST_WORDS_S = 0.5  # for pages that do not read
_SEND_BUFFER = 65_536  # bytes; what a slow page cannot take shall not pile up in the kernel


class _Connection(H11Protocol):
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
        self._stop_timer()
        if self.transport is not None:
            super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
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
    idle = [each for each in connections if isinstance(each, _Connection) and each.is_idle]
    if idle:
        # Those that never asked go first, then the oldest.
        min(idle, key=lambda each: (each.has_asked, each.since_s)).give_way()
    return bool(idle)


@dataclass(eq=False)
class WebServer:
    """Serve an application."""

    host: str
    port: int  # 0: any free one
    app: ASGIApp
    beside: Callable[[], Coroutine[Any, Any, None]]  # what runs beside it in its loop
    on_trouble: Callable[[str], None]  # hears why it cannot
    last_words: Callable[[], Coroutine[Any, Any, None]]  # what is waited for before the end

    def __post_init__(self) -> None:
        self._stop = threading.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopping = asyncio.Event()
        self._quiet_until_s = 0.0
        self._sock: socket.socket | None = None
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)
        self.address: tuple[str, int] | None = None  # where it listens; None while it does not

    def start(self) -> None:
        """Start; returns once it listens or `on_trouble` knows why not."""
        self._sock = self._bind()
        self._thread.start()

    def stop(self) -> None:
        """Begin to stop."""
        self._stop.set()
        self.post(self._stopping.set)

    def post(self, call: Callable[..., object], *values: object) -> None:
        """Call something in its loop; does nothing without one, or when that has ended."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(call, *values)

    def join(self, timeout_s: float) -> bool:
        """Wait until it has stopped; return whether it has."""
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _bind(self) -> socket.socket | None:
        sock: socket.socket | None = None
        try:
            family, kind, proto, _, address = socket.getaddrinfo(
                self.host, self.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
            )[0]
            sock = socket.socket(family, kind, proto)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind(address)
            sock.listen(_BACKLOG)
        except OSError as err:
            if sock is not None:
                sock.close()
            holder = _port_holder(self.port) if err.errno == errno.EADDRINUSE else ""
            by = f" by {holder}" if holder else ""
            self.on_trouble(f"cannot listen: {err.strerror or err}{by}")
            return None
        self.address = sock.getsockname()[:2]
        self.on_trouble("")
        return sock

    def _run(self) -> None:
        while (sock := self._sock) is None:
            if self._stop.wait(_RETRY_S):
                return
            self._sock = self._bind()
        try:
            asyncio.run(self._serve(sock))
        except Exception as err:
            log.exception("the dashboard has ended")
            self.on_trouble(f"ended: {err!r}")
        finally:
            sock.close()

    async def _serve(self, sock: socket.socket) -> None:
        config = uvicorn.Config(
            self.app,
            http=_Connection,
            ws="websockets-sansio",
            ws_max_size=_MAX_MESSAGE,
            ws_per_message_deflate=False,
            lifespan="off",
            log_config=None,
            access_log=False,
            proxy_headers=False,
            server_header=False,
            timeout_keep_alive=15,
            timeout_graceful_shutdown=1,
            h11_max_incomplete_event_size=_MAX_HEADER,
            backlog=_BACKLOG,
        )
        server = uvicorn.Server(config)
        self._loop = asyncio.get_running_loop()
        self._loop.set_exception_handler(self._fault)
        beside = [
            asyncio.create_task(self.beside()),
            asyncio.create_task(self._until_stopped(server)),
        ]
        try:
            if not self._stop.is_set():
                # Signals are the main thread's business.
                await server.serve(sockets=[sock])
        finally:
            for task in beside:
                task.cancel()
            await asyncio.gather(*beside, return_exceptions=True)

    def _fault(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Say once a minute that no page can be taken, which asyncio says many times a second."""
        err = context.get("exception")
        if not isinstance(err, OSError) or err.errno not in _TOO_MANY:
            loop.default_exception_handler(context)
        elif loop.time() >= self._quiet_until_s:
            self._quiet_until_s = loop.time() + _SAID_S
            log.warning("no further page can be opened: %s", err.strerror)

    async def _until_stopped(self, server: uvicorn.Server) -> None:
        await self._stopping.wait()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self.last_words(), _LAST_WORDS_S)
        server.should_exit = True


def _port_holder(port: int) -> str:
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
