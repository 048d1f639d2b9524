"""View: what the dashboard holds of one sensor; `SensorRouter` routes requests to sensors."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from starlette.responses import RedirectResponse
from starlette.types import Receive, Scope, Send

from radard.alarm.panel import ArmMode
from radard.config.sink_table import WebSection
from radard.outputs.base import Record
from radard.outputs.fanout import Host
from radard.web.api import OF_ONE, Api
from radard.web.auth import AccessControl
from radard.web.history import History
from radard.web.hub import Hub
from radard.web.pictures.picture_thread import PictureThread
from radard.web.queries import Queries

Post = Callable[[Callable[[Any], None], Any], None]
"""Calls something with a value in the web's own thread."""
_OWN_PATH = re.compile(r"/sensor/([A-Za-z0-9_-]+)(/.*)?")
_MOST_PANELS = 4000  # above the decisions of `radard.web.history`


class View:
    """One sensor's records, pictures, pages and routes; `sensor` is empty for the only one."""

    def __init__(
        self,
        section: WebSection,
        access: AccessControl,
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
        self.app = Api(self.queries, access, self.hub).app
        self._last: Mapping[str, Any] = {}

    def attach(self, host: Host) -> None:
        """Take the sensor's host."""
        self.queries.host = host

    def take(self, record: Record) -> None:
        """Take a record; returns at once."""
        queries = self.queries
        self._history.take(record)
        queries.metrics.on_record(record)
        if record["type"] == "decision" and queries.host is not None:
            panels, panel = queries.panels, queries.host.panel()
            mode: ArmMode = "home" if panel.get("mode") == "home" else "away"
            panels[record["seq"]] = (str(panel.get("panel", "")), mode)
            while len(panels) > _MOST_PANELS:
                del panels[next(iter(panels))]
        if len(self.hub):
            self._post(self.hub.broadcast, record)

    def poll(self) -> None:
        """Send pages what changes without a record: health, panel, playback."""
        if not len(self.hub):
            return
        now = self.queries.now()
        if now != self._last:
            self._last = now
            self.hub.broadcast({"type": "now", **now})


class SensorRouter:
    """ASGI application: /sensor/NAME/... is NAME's, everything else the first sensor's.

    `only` is the view without a name, `views` are those of several sensors.
    """

    def __init__(self, only: View, views: Mapping[str, View]) -> None:
        self._only = only
        self._views = views

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Route a request."""
        match = _OWN_PATH.fullmatch(scope.get("path", ""))
        view = self._views.get(match[1]) if match else None
        if match is None or view is None:
            first = next(iter(self._views.values()), self._only)
            await first.app(scope, receive, send)
            return
        path = match[2]
        if path is None:
            # What the page asks for lies beside it.
            await RedirectResponse(f"{match[1]}/")(scope, receive, send)
            return
        own = {**scope, "path": path, "raw_path": path.encode(), OF_ONE: match[1]}
        await view.app(own, receive, send)
