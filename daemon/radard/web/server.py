"""Server: uvicorn in a thread of its own, with limits on connections.

It starts as soon as the port is free: a busy one is logged once and tried again, and the run
goes on without a dashboard meanwhile.
"""

import asyncio
import logging
import socket
import threading
from collections.abc import Callable
from typing import Any

import h11
import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from radard.web.socket import MOST_MESSAGE

log = logging.getLogger("radard")
# Limits, all chosen: for a home's browsers and scrapers, not for the internet.
_MOST_CONNECTIONS = 256
_HEADER_S = 10.0
_MOST_HEADER = 16_384  # bytes
_RETRY_S = 5.0
_SEND_BUFFER = 65_536  # bytes; what a slow page cannot take shall not pile up in the kernel


class _Connection(H11Protocol):
    """One connection; closed when there are too many, or when it does not ask in time."""

    _late: asyncio.TimerHandle | None = None
    transport: asyncio.Transport | None  # type: ignore[assignment]

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        if len(self.connections) >= _MOST_CONNECTIONS:
            transport.abort()
            return
        super().connection_made(transport)
        own: socket.socket | None = transport.get_extra_info("socket")
        if own is not None:
            own.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self._late = self.loop.call_later(_HEADER_S, self._give_up)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._late is not None:
            self._late.cancel()
            super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        if self._late is not None:
            self._late.cancel()
        super().handle_websocket_upgrade(event)

    def _give_up(self) -> None:
        if getattr(self, "cycle", None) is None and self.transport is not None:
            self.transport.abort()


class WebServer:
    """Serve an application.

    Parameters
    ----------
    host, port
        Where to listen; port 0 is any free one.
    app : ASGI application
        What to serve.
    beside : callable
        Takes the loop of the web's thread, returns a coroutine that runs beside the server.
    on_trouble : callable
        Takes why it does not listen; an empty text once it does.
    """

    def __init__(
        self,
        host: str,
        port: int,
        app: ASGIApp,
        beside: Callable[[asyncio.AbstractEventLoop], Any],
        on_trouble: Callable[[str], None],
    ) -> None:
        self._host, self._port = host, port
        self._app = app
        self._beside = beside
        self._on_trouble = on_trouble
        self._stop = threading.Event()
        self._server: uvicorn.Server | None = None
        self._thread: threading.Thread | None = None
        self.address: tuple[str, int] | None = None
        """Where it listens; None while it does not."""

    def start(self) -> None:
        """Start; returns once it listens or `on_trouble` knows why not."""
        args = (self._bind(),)
        self._thread = threading.Thread(target=self._run, args=args, name="web", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Begin to stop."""
        self._stop.set()
        if self._server is not None:
            self._server.should_exit = True

    def join(self, timeout_s: float) -> bool:
        """Wait until it has stopped; return whether it has."""
        if self._thread is None:
            return True
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _bind(self) -> socket.socket | None:
        sock: socket.socket | None = None
        try:
            family, kind, proto, _, address = socket.getaddrinfo(
                self._host, self._port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
            )[0]
            sock = socket.socket(family, kind, proto)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind(address)
            sock.listen(128)
        except OSError as err:
            if sock is not None:
                sock.close()
            self._on_trouble(f"cannot listen: {err.strerror or err}")
            return None
        self.address = sock.getsockname()[:2]
        self._on_trouble("")
        return sock

    def _run(self, sock: socket.socket | None) -> None:
        while sock is None:
            if self._stop.wait(_RETRY_S):
                return
            sock = self._bind()
        try:
            asyncio.run(self._serve(sock))
        except Exception as err:
            log.exception("the dashboard has ended")
            self._on_trouble(f"ended: {err!r}")
        finally:
            sock.close()

    async def _serve(self, sock: socket.socket) -> None:
        config = uvicorn.Config(
            self._app,
            http=_Connection,
            ws="websockets-sansio",
            ws_max_size=MOST_MESSAGE,
            ws_per_message_deflate=False,
            lifespan="off",
            log_config=None,
            access_log=False,
            proxy_headers=False,
            server_header=False,
            timeout_keep_alive=15,
            timeout_graceful_shutdown=1,
            h11_max_incomplete_event_size=_MOST_HEADER,
        )
        self._server = uvicorn.Server(config)
        # Signals are the main thread's business.
        beside = asyncio.create_task(self._beside(asyncio.get_running_loop()))
        try:
            if not self._stop.is_set():
                await self._server.serve(sockets=[sock])
        finally:
            beside.cancel()
            await asyncio.gather(beside, return_exceptions=True)
