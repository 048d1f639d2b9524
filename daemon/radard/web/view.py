"""View: what the dashboard holds of one sensor; `Doors` leads every request to its sensor."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from starlette.types import Receive, Scope, Send

from radard.config.sink_table import WebSection
from radard.outputs.fanout import Host
from radard.sinks.base import Record
from radard.web.api import OF_ONE, Api
from radard.web.auth import AccessControl
from radard.web.history import History
from radard.web.hub import Hub
from radard.web.picture_thread import PictureThread
from radard.web.queries import Queries

Post = Callable[[Callable[[Any], None], Any], None]
_OWN_PATH = re.compile(r"/sensor/([A-Za-z0-9_-]+)(/.*)?")
_MOST_PANELS = 4000


class View:
    """One sensor's records, pictures, pages and routes.

    Parameters
    ----------
    section : WebSection
        Of the configuration.
    guard : AccessControl
        Knows roles, for all sensors.
    post : callable
        Calls something with a value in the web's own thread.
    sensor : str
        Name of one of several sensors; empty: there is only this one.
    all_views : callable
        Returns those of all sensors.
    """

    def __init__(
        self,
        section: WebSection,
        guard: AccessControl,
        post: Post,
        sensor: str,
        all_views: Callable[[], Sequence["View"]],
    ) -> None:
        self._post = post
        self._history = History()
        self.queries = Queries(
            section, self._history, sensor, lambda: [view.queries for view in all_views()]
        )
        self.hub = Hub(lambda is_wanted: self.picture_thread.want(is_wanted=is_wanted))
        self.picture_thread = PictureThread(
            lambda: self.queries.host.ring() if self.queries.host is not None else None,
            lambda axes: post(self.hub.announce, axes),
            lambda data: post(self.hub.show, data),
        )
        self.app = Api(self.queries, guard, self.hub).app
        self._last: Mapping[str, Any] = {}

    def attach(self, host: Host) -> None:
        """Take what the sensor's run offers."""
        self.queries.host = host

    def take(self, record: Record) -> None:
        """Take a record; returns at once."""
        queries = self.queries
        self._history.take(record)
        queries.metrics.on_record(record)
        if record["type"] == "decision" and queries.host is not None:
            panels = queries.panels
            panels[record["seq"]] = str(queries.host.panel().get("panel", ""))
            while len(panels) > _MOST_PANELS:
                del panels[next(iter(panels))]
        if len(self.hub):
            self._post(self.hub.broadcast, record)

    def look(self) -> None:
        """Tell pages what changes without a record: health, panel, playback."""
        if not len(self.hub):
            return
        now = self.queries.now()
        if now != self._last:
            self._last = now
            self.hub.broadcast({"type": "now", **now})


class Doors:
    """ASGI application: /sensor/NAME/... is NAME's, everything else the first sensor's.

    Parameters
    ----------
    first : View
        Of the only sensor.
    views : mapping of str to View
        Of several sensors; empty when there is only one.
    """

    def __init__(self, first: View, views: Mapping[str, View]) -> None:
        self._first = first
        self._views = views

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand on a request."""
        match = _OWN_PATH.fullmatch(scope.get("path", ""))
        view = self._views.get(match[1]) if match else None
        if match is None or view is None:
            first = next(iter(self._views.values()), self._first)
            await first.app(scope, receive, send)
            return
        path = match[2] or "/"
        own = {**scope, "path": path, "raw_path": path.encode(), OF_ONE: match[1]}
        await view.app(own, receive, send)
