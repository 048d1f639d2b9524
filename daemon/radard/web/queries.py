"""Queries: what the routes answer with, gathered from the run, its store and its files."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from radard.alarm.sensitivity import alarm_policy
from radard.config.config import Config
from radard.config.directories import state_dir, zones_file
from radard.config.redact import redact_value
from radard.config.sink_table import WebSection
from radard.health.health import Status, overall
from radard.outputs.fanout import Host
from radard.sinks.store_query import StoreError, read_events
from radard.web.auth import Role
from radard.web.history import History
from radard.web.labels import LabelFile
from radard.web.metrics import Metrics, exposition
from radard.web.why import explain

_ULID = re.compile(r"[0-9A-HJKMNP-TV-Z]{26}")
_MOST_EVENTS = 2000
_N_BEFORE = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class EventFilter:
    """Which events are wanted.

    Attributes
    ----------
    kinds : tuple of str
        Only these; none means all.
    since_s : float or None
        Begun at this wall-clock time or later, in seconds since 1970.
    label : str
        Only with this label; 'none': without one; empty: all.
    text : str
        Their reason or id holds this.
    limit : int
        The newest so many.
    """

    kinds: tuple[str, ...] = ()
    since_s: float | None = None
    label: str = ""
    text: str = ""
    limit: int = 200


class Queries:
    """Answers.

    Parameters
    ----------
    section : WebSection
        Of the configuration.
    history : History
        Fed by the sink.
    sensor : str
        Name of one of several sensors; empty: there is only this one.
    all_desks : callable
        Returns the desks of all sensors.
    """

    def __init__(
        self,
        section: WebSection,
        history: History,
        sensor: str = "",
        all_desks: Callable[[], Sequence["Queries"]] = tuple,
    ) -> None:
        self.section = section
        self.history = history
        self.metrics = Metrics(sensor)
        self._sensor = sensor
        self._all_desks = all_desks
        self.panels: dict[int, str] = {}
        """State of the panel just before a decision, by the decision's number."""
        self.host: Host | None = None
        self._labels: LabelFile | None = None

    @property
    def config(self) -> Config:
        """The configuration that holds."""
        return self.host.config() if self.host is not None else Config()

    @property
    def label_file(self) -> LabelFile:
        """Where labels go."""
        path = self.section.labels_file or state_dir(self.config) / "labels.jsonl"
        if self._labels is None or self._labels.path != path:
            self._labels = LabelFile(path)
        return self._labels

    @property
    def zones_file(self) -> Path:
        """Where zones that are saved here go."""
        return zones_file(self.config)

    def now(self) -> dict[str, Any]:
        """Return what changes from moment to moment."""
        host = self.host
        zones = {"zones": self.config.zones.model_dump(mode="json")}
        if host is None:
            return {"state": "starting", "reason": "", "panel": {}, **zones, "playback": None}
        status, playback = host.health.status, host.playback()
        state = playback.state if playback is not None else None
        return {
            "state": status.state,
            "reason": status.reason,
            "panel": dict(host.panel()),
            **zones,
            "playback": state
            and {
                "position_s": round(state.position_s, 2),
                "length_s": round(state.length_s, 2),
                "is_playing": state.is_playing,
                "speed": state.speed,
            },
        }

    def status(self, role: Role) -> dict[str, Any]:
        """Return what a page needs to begin with."""
        config, hello = self.config, self.history.hello
        policy = alarm_policy(config.alarm, hello.get("policy", "window"))
        return {
            **self.now(),
            "role": role,
            "sensor": config.sensor.name,
            "hello": dict(hello),
            "confirm": [policy.k, policy.n],
            "latch_s": policy.latch_s,
            "has_saved_zones": self.zones_file.is_file(),
            "sensors": {**self._beside(), **self.section.sensors},
            "has_store": self._store() is not None,
            "outputs": [
                {"name": s.name, "status": s.state.status, "reason": s.state.reason}
                for s in (self.host.sinks() if self.host is not None else ())
            ],
        }

    def config_shown(self) -> dict[str, Any]:
        """Return the configuration without secrets."""
        shown: dict[str, Any] = redact_value("", self.config.model_dump(mode="json"))
        return shown

    def health(self, *, is_whole: bool) -> Status:
        """Return the state of this sensor, or of all sensors of the process together."""
        desks = self._all_desks() if is_whole else ()
        hosts = [queries.host for queries in desks or (self,) if queries.host is not None]
        if not hosts:
            return Status("starting", "")
        return overall({host.sensor: host.health for host in hosts})

    def metrics_text(self) -> str:
        """Return Prometheus' text, of all sensors of the process."""
        desks = self._all_desks() or (self,)
        for queries in desks:
            queries.refresh_metrics()
        host = self.host
        sinks = host.sinks() if host is not None else ()
        return exposition([queries.metrics for queries in desks], sinks)

    def refresh_metrics(self) -> None:
        """Ask the run for what no record says."""
        host = self.host
        if host is not None:
            self.metrics.refresh(
                state=host.health.status.state,
                is_armed=bool(host.panel().get("armed", True)),
                driver=host.driver(),
            )

    def _beside(self) -> dict[str, str]:
        """Return the other sensors of this process, and where their pages are."""
        hosts = [queries.host for queries in self._all_desks()]
        others = [host.sensor for host in hosts if host is not None and host is not self.host]
        return {name: f"/sensor/{name}/" for name in others}

    def why(self, seq: int) -> dict[str, Any] | None:
        """Return a decision, those before it and why it is so; None when it is not known."""
        records = self.history.around(seq, _N_BEFORE)
        if not records:
            return None
        reasons = explain(
            records,
            self.history.hello,
            self.config,
            self.history.events(),
            self.panels.get(seq),
        )
        return {"decision": dict(records[-1]), **reasons}

    def events(self, wanted: EventFilter) -> list[dict[str, Any]]:
        """Return events, the newest first: of the store where there is one, else of this run."""
        labels = self.label_file.labels()
        found = [_shown(e, labels) for e in self._all_events(wanted)]
        found = [e for e in found if _fits(e, wanted)]
        return found[: wanted.limit]

    def event(self, event_id: str) -> dict[str, Any] | None:
        """Return one event; None when it is not known."""
        if not _ULID.fullmatch(event_id):
            return None
        found = self.events(EventFilter(text=event_id, limit=1))
        return found[0] if found else None

    def clip(self, event_id: str) -> Path | None:
        """Return the clip of an event, if it is there.

        The name in the record is not trusted further than the event's own id.
        """
        event = self.event(event_id)
        path = Path(event["clip"]) if event and event["clip"] else None
        if path is None or path.name != f"{event_id}.h5" or not path.is_file():
            return None
        return path

    def _all_events(self, wanted: EventFilter) -> Sequence[Mapping[str, Any]]:
        own = {e["id"]: _of_record(e, self.config.sensor.name) for e in self.history.events()}
        store = self._store()
        if store is not None:
            try:
                stored = read_events(store, since_s=wanted.since_s, limit=_MOST_EVENTS)
            except StoreError:
                stored = []
            for event in stored:
                if self._sensor and event.sensor != self._sensor:
                    continue
                known = own.get(event.id, {})
                own[event.id] = {**_of_store(event), **known}
        return sorted(own.values(), key=lambda e: str(e["began"]), reverse=True)

    def _store(self) -> Path | None:
        for output in self.config.output:
            scheme, _, rest = output.partition(":")
            if scheme == "store" and Path(rest).is_file():
                return Path(rest)
        return None


def _of_record(record: Mapping[str, Any], sensor: str) -> dict[str, Any]:
    return {
        "id": record["id"],
        "sensor": sensor,
        "kind": record["kind"],
        "phase": record["phase"],
        "began": record["began"],
        "ended": record["time"] if record["phase"] == "end" else None,
        "start_t_s": record["start_t_s"],
        "end_t_s": record["end_t_s"],
        "peak": record["peak"],
        "reason": record["cause"],
        "clip": record["clip"],
    }


def _of_store(event: Any) -> dict[str, Any]:
    return {
        "id": event.id,
        "sensor": event.sensor,
        "kind": event.kind,
        "phase": event.phase,
        "began": event.start_time,
        "ended": event.end_time,
        "start_t_s": event.start_t_s,
        "end_t_s": event.end_t_s,
        "peak": event.peak,
        "reason": event.reason,
        "clip": event.clip,
    }


def _shown(event: Mapping[str, Any], labels: Mapping[str, str]) -> dict[str, Any]:
    clip = event["clip"]
    return {
        **event,
        "has_clip": bool(clip) and Path(clip).is_file(),
        "label": labels.get(event["id"]),
    }


def _fits(event: Mapping[str, Any], wanted: EventFilter) -> bool:
    if wanted.kinds and event["kind"] not in wanted.kinds:
        return False
    if wanted.label and (event["label"] or "none") != wanted.label:
        return False
    return wanted.text.lower() in f"{event['reason']} {event['id']}".lower()
