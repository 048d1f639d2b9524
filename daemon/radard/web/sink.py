"""WebSink: the dashboard as an output.

`write` keeps a record and returns; that is all it does in the worker's thread.
"""

import asyncio
import logging
from urllib.parse import urlsplit

from radard.config.credentials import redact
from radard.config.sink_table import SinkOptions, WebSection
from radard.errors import UsageError
from radard.log import EventLog
from radard.outputs.base import Host, Record, SinkContext, SinkState, StateKeeper
from radard.outputs.thread_sink import CLOSE_S
from radard.outputs.tls import shown_host
from radard.web.api import Api, SensorRouter
from radard.web.auth import AccessControl, read_tokens
from radard.web.server import WebServer
from radard.web.view import View
from x2radar.ports import is_host

_log = logging.getLogger("radard")
PORT = 8434  # no other service of a home has it (IANA: unassigned)
_POLL_S = 0.5  # how soon pages show health, panel and playback


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
        tokens = read_tokens(section, host)
        self._access = AccessControl(tokens, may_command=section.commands, cookie=f"radard_{port}")
        self._views: dict[str, View] = {}
        self.app = SensorRouter(self._views)  # what it serves: an ASGI application
        self._server = WebServer(
            host, port, self.app, self._poll_views, self._on_trouble, last_words=self._last_words
        )

    def _all_views(self) -> list[View]:
        return list(self._views.values())

    @property
    def state(self) -> SinkState:
        """Whether the port is served; for any thread."""
        return self._keeper.state(0)

    @property
    def url(self) -> str | None:
        """Its URL; None while it does not listen."""
        if (address := self._server.address) is None:
            return None
        return f"http://{shown_host(address[0])}:{address[1]}/"

    def start(self) -> None:
        """Begin to listen; a port that is not free is logged, and tried again."""
        self._server.start()
        if self.url is not None:
            _log.getChild("dashboard").info("listening at %s", self.url)

    def attach(self, host: Host) -> None:
        """Take a sensor's host; one of several gets pages of its own."""
        sensor = host.sensor if host.config().is_one_of_several else ""
        view = View(self._section, self._log, self._server.post, host, sensor)
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
        if self._server.address is not None:
            self._keeper.sent(is_event=record["type"] == "event")

    def finish(self, timeout_s: float | None = None) -> None:  # noqa: ARG002
        """End the picture threads and begin to stop the server."""
        for view in self._all_views():
            view.picture_thread.close()
        self._server.stop()

    def close(self, timeout_s: float | None = None) -> None:
        """Finish, and wait for the server's thread."""
        self.finish()
        if not self._server.join(CLOSE_S if timeout_s is None else timeout_s):
            _log.warning("%s: did not end in time", self.name)

    async def _poll_views(self) -> None:
        """Send pages what changes without a record."""
        while True:
            await asyncio.sleep(_POLL_S)
            for view in self._all_views():
                view.poll()

    async def _last_words(self) -> None:
        """Wait until every page knows how the run has ended."""
        await asyncio.gather(*(view.hub.has_sent_all() for view in self._all_views()))

    def _on_trouble(self, reason: str) -> None:
        if reason:
            self._keeper.failed(f"{reason}; the dashboard waits for it")
            return
        was_ok = self.state.is_ok
        self._keeper.sent(0)
        if not was_ok:
            _log.warning("dashboard at %s", self.url)
