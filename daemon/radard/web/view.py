"""View: what the dashboard holds of one sensor, and what of it every page shows."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from starlette.types import ASGIApp

from radard.alarm.sensor_state import SensorState
from radard.config.config import Config
from radard.config.directories import state_dir
from radard.config.saved import SavedSettings
from radard.config.sink_table import WebSection
from radard.log import EventLog
from radard.outputs.base import Host, Record
from radard.web.history import History
from radard.web.hub import Hub
from radard.web.metrics import Metrics
from radard.web.pictures.picture_thread import PictureThread

Post = Callable[[Callable[[Any], None], Any], None]  # a call in the web's own thread
_MAX_STATES = 4000  # above the decisions of `radard.web.history`


class View:
    """One sensor's records, counters, pages and pictures; `sensor` is empty for an only one."""

    def __init__(
        self,
        section: WebSection,
        log: EventLog,
        post: Post,
        sensor: str,
        make_app: Callable[["View"], ASGIApp],
    ) -> None:
        self.section, self.log, self.sensor = section, log, sensor
        self.host: Host | None = None  # the sensor's run, once there is one
        self.history, self.metrics = History(), Metrics(sensor)
        self.states: dict[int, SensorState] = {}  # held just before each decision, by number
        self.hub = Hub(lambda is_wanted: self.picture_thread.want(is_wanted=is_wanted))
        self.picture_thread = PictureThread(
            lambda: self.host.ring() if self.host is not None else None,
            lambda axes: post(self.hub.announce, axes),
            lambda data: post(self.hub.show, data),
        )
        self.app = make_app(self)
        self._post = post
        self._last: Mapping[str, Any] = {}

    @property
    def config(self) -> Config:
        """The sensor's configuration that holds; built-in values before there is a sensor."""
        return self.host.config() if self.host is not None else Config()

    @property
    def label_file(self) -> Path:
        """Path of the file that labels are appended to."""
        return self.section.labels_file or state_dir(self.config) / "labels.jsonl"

    @property
    def store(self) -> Path | None:
        """The file of an output `store:` that is there."""
        for output in self.config.output:
            scheme, _, rest = output.partition(":")
            if scheme == "store" and Path(rest).is_file():
                return Path(rest)
        return None

    def take(self, record: Record) -> None:
        """Take a record; returns at once."""
        self.history.take(record)
        self.metrics.on_record(record)
        state = self.host.panel() if self.host is not None else None
        if record["type"] == "decision" and state is not None:
            self.states[record["seq"]] = state
            while len(self.states) > _MAX_STATES:
                del self.states[next(iter(self.states))]
        if len(self.hub):
            self._post(self.hub.broadcast, record)

    def poll(self) -> None:
        """Send pages what changes without a record: health, panel, playback."""
        if len(self.hub) and (now := self.now()) != self._last:
            self._last = now
            self.hub.broadcast({"type": "now", **now})

    def now(self) -> dict[str, Any]:
        """Return state, panel, zones, settings and playback at this moment."""
        host, config = self.host, self.config
        settings = SavedSettings.model_validate(config, from_attributes=True)
        held = {"zones": config.zones.model_dump(mode="json"), "settings": settings.model_dump()}
        if host is None:
            return {"state": "starting", "reason": "", "panel": {}, **held, "playback": None}
        status, panel, playback = host.health.status, host.panel(), host.playback()
        state = playback.state if playback is not None else None
        return {
            "state": status.state,
            "reason": status.reason,
            "panel": panel.as_record(host.mark()) if panel is not None else {},
            **held,
            "playback": state
            and {
                "position_s": round(state.position_s, 2),
                "length_s": round(state.length_s, 2),
                "is_playing": state.is_playing,
                "speed": state.speed,
            },
        }

    def refreshed_metrics(self) -> Metrics:
        """Return the counters, with what holds at this moment."""
        if (host := self.host) is not None:
            panel = host.panel()
            self.metrics.refresh(
                state=host.health.status.state,
                is_armed=panel is None or panel.armed,
                driver=host.driver(),
                drift=panel.clock_drift if panel is not None else None,
            )
        return self.metrics
