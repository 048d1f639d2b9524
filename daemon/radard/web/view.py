"""View: what the dashboard holds of one sensor, and what of it every page shows."""

import threading
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
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
from radard.web.hub import Hub
from radard.web.metrics import Metrics
from radard.web.pictures.picture_thread import PictureThread

DECISIONS, EVENTS = 3600, 500  # an hour of decisions, and as many events as a page shows
N_BEFORE = 16  # decisions that confirmation looks at, at most (`alarm.confirm_n`)
_MAX_ALARMS = 100  # whose decisions are kept for longer: days of them
Post = Callable[[Callable[[Any], None], Any], None]  # a call in the web's own thread
Held = tuple[Record, SensorState | None]  # a decision, and what held just before it


class History:
    """The last decisions, longer before alarms, the last events' last phase, and the hello."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.hello: Record = {}  # the run's first record; empty before it came
        self._decisions: deque[Held] = deque(maxlen=DECISIONS)
        self._events: dict[str, Record] = {}
        self._causes: dict[str, list[Held]] = {}

    def take(self, record: Record, state: SensorState | None = None) -> None:
        """Keep a decision with the state before it, or an event, and what began an alarm."""
        kind = record["type"]
        with self._lock:
            if kind == "decision":
                self._decisions.append((record, state))
            elif kind == "event":
                first = self._events.pop(record["id"], record)
                last = list(self._decisions)[-N_BEFORE - 1 :]
                is_new = first is record and record["kind"] == "alarm"
                if is_new and last and last[-1][0]["t_s"] == record["start_t_s"]:
                    self._causes[record["id"]] = last
                self._events[record["id"]] = {
                    **record,
                    "began": first.get("began", first["time"]),
                    "cause": first.get("cause", first["reason"]),
                    "clip": record["clip"] or first["clip"],
                    "peak": max(record["peak"], first["peak"]),
                }
                for kept, most in ((self._events, EVENTS), (self._causes, _MAX_ALARMS)):
                    if len(kept) > most:
                        del kept[next(iter(kept))]
            elif kind == "hello":
                self.hello = record

    def decisions(self, limit: int, *, before_seq: int = 0) -> list[Record]:
        """Return the newest decisions, before one if that is named, oldest first."""
        with self._lock:
            known = [d for d, _ in self._decisions if not before_seq or d["seq"] < before_seq]
        return known[-limit:] if limit else []

    def around(self, seq: str) -> list[Held]:
        """Return a decision and `N_BEFORE` before it, oldest first; empty when it is not known."""
        with self._lock:
            known, causes = list(self._decisions), list(self._causes.values())
        at = next((i for i, (record, _) in enumerate(known) if str(record["seq"]) == seq), None)
        if at is not None:
            return known[max(0, at - N_BEFORE) : at + 1]
        return next((found for found in causes if str(found[-1][0]["seq"]) == seq), [])

    def cause(self, event_id: str) -> int | None:
        """Return the number of the decision that an alarm began with; None if not known."""
        with self._lock:
            found = self._causes.get(event_id)
        return None if found is None else int(found[-1][0]["seq"])

    def events(self) -> list[Mapping[str, Any]]:
        """Return events of this run, oldest first, each in its last phase."""
        with self._lock:
            return list(self._events.values())


class View:
    """One sensor's records, counters, pages and pictures; `sensor` is empty for an only one."""

    app: ASGIApp  # its pages

    def __init__(
        self, section: WebSection, log: EventLog, post: Post, host: Host, sensor: str
    ) -> None:
        self.section, self.log, self.host, self.sensor = section, log, host, sensor
        self.history, self.metrics = History(), Metrics(sensor)
        self.hub = Hub(lambda is_wanted: self.picture_thread.want(is_wanted=is_wanted))
        announce, show = partial(post, self.hub.announce), partial(post, self.hub.show)
        self.picture_thread = PictureThread(host.ring, announce, show)
        self._post = post
        self._last: Mapping[str, Any] = {}

    @property
    def config(self) -> Config:
        """The sensor's configuration that holds."""
        return self.host.config()

    @property
    def label_file(self) -> Path:
        """Path of the file that labels are appended to."""
        return self.section.labels_file or state_dir(self.config) / "labels.jsonl"

    def take(self, record: Record) -> None:
        """Take a record; returns at once."""
        self.history.take(record, self.host.panel())
        self.metrics.on_record(record)
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
        status, panel, playback = host.health.status, host.panel(), host.playback()
        return {
            "state": status.state,
            "reason": status.reason,
            "panel": panel.as_record(host.mark()) if panel is not None else {},
            "zones": config.zones.model_dump(mode="json"),
            "settings": settings.model_dump(),
            "playback": playback.state if playback is not None else None,
        }
