"""WebSink: the dashboard as an output.

`write` keeps a record and returns; that is all it does in the worker's thread.
"""

import asyncio
import logging
from typing import Any
from urllib.parse import urlsplit

from radard.errors import UsageError
from radard.outputs import Host
from radard.sinks.base import Record, SinkContext, SinkState, StateKeeper
from radard.sinks.options import SinkOptions
from radard.web.api import Api
from radard.web.desk import Desk
from radard.web.guard import Guard, read_tokens
from radard.web.history import History
from radard.web.hub import Hub
from radard.web.onlooker import Onlooker
from radard.web.server import WebServer
from radard.web_settings import WebSection

log = logging.getLogger("radard")
PORT = 8434
_LOOK_S = 0.5
_CLOSE_S = 2.0
_MOST_PANELS = 4000


def open_from_url(url: str, options: SinkOptions, context: SinkContext) -> "WebSink":  # noqa: ARG001
    """Return the dashboard of `http://HOST:PORT`, at work."""
    host, port = parse_address(url)
    sink = WebSink(host, port, options.web)
    sink.start()
    return sink


def parse_address(url: str) -> tuple[str, int]:
    """Return host and port; raise UsageError if `url` is no plain http://HOST:PORT."""
    try:
        parts = urlsplit(url)
        port = PORT if parts.port is None else parts.port
    except ValueError:
        parts, port = urlsplit(""), 0
    is_plain = parts.path in {"", "/"} and not (parts.query or parts.fragment or parts.username)
    if parts.scheme != "http" or not parts.hostname or not is_plain:
        msg = f"--output '{url}': use http://127.0.0.1:{PORT}, or another address of this machine"
        raise UsageError(msg)
    return parts.hostname, port


class WebSink:
    """Serve the dashboard.

    Parameters
    ----------
    host, port
        Where to listen; port 0 is any free one.
    section : WebSection
        Of the configuration.

    Raises
    ------
    ConfigError
        If a token is missing or cannot be read.
    """

    waits = False

    def __init__(self, host: str, port: int, section: WebSection) -> None:
        self.name = f"http://{f'[{host}]' if ':' in host else host}:{port}"
        self._keeper = StateKeeper()
        self._history = History()
        self._desk = Desk(section, self._history)
        tokens = read_tokens(section, host)
        guard = Guard(tokens, may_command=section.commands, cookie=f"radard_{port}")
        self._hub = Hub(lambda is_wanted: self._onlooker.want(is_wanted=is_wanted))
        self._onlooker = Onlooker(
            lambda: self._desk.host.ring() if self._desk.host is not None else None,
            lambda axes: self._post(self._hub.announce, axes),
            lambda data: self._post(self._hub.show, data),
        )
        self._loop: asyncio.AbstractEventLoop | None = None
        self._server = WebServer(
            host, port, Api(self._desk, guard, self._hub).app, self._beside, self._trouble
        )

    @property
    def state(self) -> SinkState:
        """As in `Sink`."""
        return self._keeper.state(0)

    @property
    def url(self) -> str | None:
        """Where pages find it; None while it does not listen."""
        address = self._server.address
        if address is None:
            return None
        host, port = address
        return f"http://{f'[{host}]' if ':' in host else host}:{port}/"

    def start(self) -> None:
        """Begin to listen; a port that is not free is said, and tried again."""
        self._server.start()
        if self.url is not None:
            log.info("dashboard at %s", self.url)

    def attach(self, host: Host) -> None:
        """Take what the run offers."""
        self._desk.host = host

    def write(self, record: Record) -> None:
        """As in `Sink`."""
        self._history.take(record)
        self._desk.metrics.on_record(record)
        if record["type"] == "decision" and self._desk.host is not None:
            panels = self._desk.panels
            panels[record["seq"]] = str(self._desk.host.panel().get("panel", ""))
            while len(panels) > _MOST_PANELS:
                del panels[next(iter(panels))]
        if self._server.address is not None:
            self._keeper.sent()
        if len(self._hub):
            self._post(self._hub.broadcast, record)

    def finish(self, timeout_s: float | None = None) -> None:  # noqa: ARG002
        """As in `Sink`."""
        self._onlooker.close()
        self._server.stop()

    def close(self, timeout_s: float | None = None) -> None:
        """As in `Sink`."""
        self.finish()
        if not self._server.join(_CLOSE_S if timeout_s is None else timeout_s):
            log.warning("%s: did not end in time", self.name)

    def _post(self, call: Any, value: Any) -> None:
        """Call something in the web's own thread; does nothing without one."""
        loop = self._loop
        if loop is not None:
            try:
                loop.call_soon_threadsafe(call, value)
            except RuntimeError:
                # The loop has closed between the two lines: the run is over.
                self._loop = None

    async def _beside(self, loop: asyncio.AbstractEventLoop) -> None:
        """Tell pages what changes without a record: health, panel, playback."""
        self._loop = loop
        last: dict[str, Any] = {}
        try:
            while True:
                await asyncio.sleep(_LOOK_S)
                if not len(self._hub):
                    continue
                now = self._desk.now()
                if now != last:
                    last = now
                    self._hub.broadcast({"type": "now", **now})
        finally:
            self._loop = None

    def _trouble(self, reason: str) -> None:
        if reason and self._keeper.failed(reason):
            log.warning("%s: %s; the dashboard waits for it", self.name, reason)
        elif not reason and self._keeper.sent(0):
            log.warning("dashboard at %s", self.url)
