"""WebSink: the dashboard as an output, served by uvicorn in a thread of its own.

`write` keeps a record and returns. While the port is not free the run goes on without a dashboard.
"""

import asyncio
import contextlib
import errno
import logging
import re
import socket
import threading
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

import uvicorn
from starlette.responses import JSONResponse, RedirectResponse
from starlette.types import Receive, Scope, Send

from radard.config.credentials import redact
from radard.config.sink_table import SinkOptions, WebSection
from radard.errors import UsageError
from radard.log import EventLog
from radard.outputs.base import Host, Record, SinkContext, SinkState, StateKeeper
from radard.outputs.thread_sink import CLOSE_S
from radard.outputs.tls import shown_host
from radard.web.api import OF_ONE, Api
from radard.web.auth import AccessControl, read_tokens
from radard.web.server import Connection, port_holder
from radard.web.view import View
from x2radar.ports import is_host

log = logging.getLogger("radard")
PORT = 8434  # no other service of a home has it (IANA: unassigned)
_POLL_S = 0.5  # how soon pages show health, panel and playback
_MAX_HEADER, _MAX_MESSAGE = 16_384, 512  # bytes; the longest that a page sends has thirty
_RETRY_S = 5.0
_WAITS = "the dashboard waits for it"
_BACKLOG = 128  # connections that wait to be taken
_TOO_MANY = {errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM}
_SAID_S = 60.0  # how often that is said
_NO_RUN = JSONResponse({"state": "starting", "error": "there is no run yet"}, 503)
_OWN_PATH = re.compile(r"/sensor/([A-Za-z0-9_-]+)(/.*)?")
_LAST_WORDS_S = 0.5  # for pages that do not read


def open_from_url(url: str, options: SinkOptions, context: SinkContext) -> "WebSink":
    """Return the dashboard of `http://HOST:PORT`."""
    host, port = parse_address(url)
    return WebSink(host, port, options.web, context.log)


def parse_address(url: str) -> tuple[str, int]:
    """Return host and port; raise UsageError if `url` is no plain http://HOST:PORT."""
    try:
        parts = urlsplit(url)
        port = PORT if parts.port is None else parts.port
    except ValueError:
        parts, port = urlsplit(""), 0
    is_plain = parts.path in {"", "/"} and not set("?#@") & set(url)
    host = parts.hostname or ""
    if parts.scheme != "http" or not is_host(host) or not is_plain:
        fault = f"use http://127.0.0.1:{PORT}, or another address of this machine"
        raise UsageError(f"--output {redact(url)!r}: {fault}")
    return host, port


class WebSink:
    """Serves dashboard, HTTP interface and metrics from the records."""

    waits = False

    def __init__(self, host: str, port: int, section: WebSection, log: EventLog) -> None:
        self.name = f"http://{shown_host(host)}:{port}"
        self._keeper = StateKeeper(self.name)
        self._section, self._log = section, log
        tokens, cookie = read_tokens(section, host), f"radard_{port}"
        self._access = AccessControl(*tokens, may_command=section.commands, cookie=cookie)
        self._views: dict[str, View] = {}
        self._host, self._port = host, port
        self._stop = threading.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopping = asyncio.Event()
        self._quiet_until_s = 0.0
        self._sock: socket.socket | None = None
        self.url: str | None = None  # where it listens; None while it does not
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)

    def _all_views(self) -> list[View]:
        return list(self._views.values())

    @property
    def state(self) -> SinkState:
        """Whether the port is served; for any thread."""
        return self._keeper.state(0)

    def start(self) -> None:
        """Begin to listen; a port that is not free is logged, and tried again."""
        self._sock = self._bind()
        self._thread.start()
        if self.url is not None:
            log.getChild("dashboard").info("listening at %s", self.url)

    def attach(self, host: Host) -> None:
        """Take a sensor's host; one of several gets pages of its own."""
        sensor = host.sensor if host.config().is_one_of_several else ""
        view = View(self._section, self._log, self._post, host, sensor)
        view.app = Api(view, self._access, self._all_views).app
        self._views[sensor] = view
        view.picture_thread.start()

    def detach(self, sensor: str) -> None:
        """Take the pages of a sensor away."""
        if (view := self._views.pop(sensor, None)) is not None:
            view.picture_thread.close()

    def write(self, record: Record) -> None:
        """Hand a record to the view of its sensor."""
        view = self._views.get(record.get("sensor", ""), self._views.get(""))
        if view is not None:
            view.take(record)
        if self.url is not None:
            self._keeper.sent(is_event=record["type"] == "event")

    def finish(self, timeout_s: float | None = None) -> None:  # noqa: ARG002
        """End the picture threads and begin to stop the server."""
        for view in self._all_views():
            view.picture_thread.close()
        self._stop.set()
        self._post(self._stopping.set)

    def close(self, timeout_s: float | None = None) -> None:
        """Finish, and wait for the server's thread."""
        self.finish()
        if self._thread.ident is not None:
            self._thread.join(CLOSE_S if timeout_s is None else timeout_s)
        if self._thread.is_alive():
            log.warning("%s: did not end in time", self.name)

    async def app(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, as ASGI has it: /sensor/NAME/... is NAME's, all else the first sensor's."""
        match = _OWN_PATH.fullmatch(scope.get("path", ""))
        view = self._views.get(match[1]) if match else None
        if match is None or view is None:
            first = next((each.app for each in self._views.values()), _NO_RUN)
            await first(scope, receive, send)
        elif match[2] is None:
            # What the page asks for lies beside it.
            await RedirectResponse(f"{match[1]}/")(scope, receive, send)
        else:
            own = {**scope, "path": match[2], "raw_path": match[2].encode(), OF_ONE: match[1]}
            await view.app(own, receive, send)

    def _post(self, call: Callable[..., object], *values: object) -> None:
        """Call something in the web's own thread; does nothing without one, or when it ends."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(call, *values)

    def _bind(self) -> socket.socket | None:
        sock: socket.socket | None = None
        try:
            family, kind, proto, _, address = socket.getaddrinfo(
                self._host, self._port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
            )[0]
            sock = socket.socket(family, kind, proto)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind(address)
            sock.listen(_BACKLOG)
        except OSError as err:
            if sock is not None:
                sock.close()
            holder = port_holder(self._port) if err.errno == errno.EADDRINUSE else ""
            by = f" by {holder}" if holder else ""
            self._keeper.failed(f"cannot listen: {err.strerror or err}{by}; {_WAITS}")
            return None
        host, port = sock.getsockname()[:2]
        self.url = f"http://{shown_host(host)}:{port}/"
        was_ok = self.state.is_ok
        self._keeper.sent(0)
        if not was_ok:
            log.warning("dashboard at %s", self.url)
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
            self._keeper.failed(f"ended: {err!r}; {_WAITS}")
        finally:
            sock.close()

    async def _serve(self, sock: socket.socket) -> None:
        config = uvicorn.Config(
            self.app,
            interface="asgi3",
            http=Connection,
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
        beside = asyncio.create_task(self._tend_pages(server))
        try:
            if not self._stop.is_set():
                # Signals are the main thread's business.
                await server.serve(sockets=[sock])
        finally:
            beside.cancel()
            await asyncio.gather(beside, return_exceptions=True)

    def _fault(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Say once a minute that no page can be taken, which asyncio says many times a second."""
        err = context.get("exception")
        if not isinstance(err, OSError) or err.errno not in _TOO_MANY:
            loop.default_exception_handler(context)
        elif loop.time() >= self._quiet_until_s:
            self._quiet_until_s = loop.time() + _SAID_S
            log.warning("no further page can be opened: %s", err.strerror)

    async def _tend_pages(self, server: uvicorn.Server) -> None:
        """Send pages what changes without a record; then how the run has ended, and stop."""
        while not self._stopping.is_set():
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._stopping.wait(), _POLL_S)
            for view in self._all_views():
                view.poll()
        told = asyncio.gather(*(view.hub.has_sent_all() for view in self._all_views()))
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(told, _LAST_WORDS_S)
        server.should_exit = True
