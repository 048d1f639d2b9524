"""Queries: the answers of the routes, from the run, its store and its files."""

import contextlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from radard.alarm.explain import explain
from radard.alarm.panel import ArmMode
from radard.alarm.sensitivity import alarm_policy, sensitivity_choices
from radard.config.config import Config
from radard.config.directories import kept_calibration, saved_file, state_dir
from radard.config.redact import redact_value
from radard.config.saved import KINDS, Kind, SavedSettings
from radard.config.sections import AUTO_MODEL
from radard.config.sink_table import WebSection
from radard.detect.calibration import load_calibration, restless_spans
from radard.errors import ConfigError, ModelMismatch
from radard.health.health import Status, overall
from radard.judge.card import read_card
from radard.outputs.base import Sink
from radard.outputs.fanout import Host
from radard.outputs.store import MARKS
from radard.outputs.store_query import StoredEvent, StoreError, read_events
from radard.web.auth import Role
from radard.web.history import History
from radard.web.labels import LabelFile
from radard.web.metrics import Metrics, exposition

_ULID = re.compile(r"[0-9A-HJKMNP-TV-Z]{26}")
_NUMBERS = ("confirm_k", "confirm_n", "p_on", "p_off")
_MOST_EVENTS = 2000  # chosen: what an answer reads of a store
_SAME = ("id", "kind", "phase", "start_t_s", "end_t_s", "peak", "clip")
"""What an answer has under the name that a record and a stored event have, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EventFilter:
    """Which events are wanted; empty means all."""

    kinds: tuple[str, ...] = ()
    since_s: float | None = None
    """Begun at this wall-clock time or later, in seconds since 1970."""
    label: str = ""
    """'none': without one."""
    text: str = ""
    """Part of their reason or id."""
    limit: int = 200


class Queries:
    """Answers about one sensor.

    Parameters
    ----------
    section : WebSection
        Of the configuration.
    history : History
        Filled by the sink.
    sensor : str
        Name of one of several sensors; empty: there is only this one.
    of_all : callable
        Returns the queries of all sensors.
    """

    def __init__(
        self,
        section: WebSection,
        history: History,
        sensor: str,
        of_all: Callable[[], Sequence["Queries"]],
    ) -> None:
        self.section = section
        self.history = history
        self.metrics = Metrics(sensor)
        self._sensor = sensor
        self._of_all = of_all
        self.panels: dict[int, tuple[str, ArmMode]] = {}
        """State of the panel just before each decision, and how it was armed, by its number."""
        self.host: Host | None = None
        self._labels: LabelFile | None = None

    @property
    def config(self) -> Config:
        """The configuration that holds."""
        return self.host.config() if self.host is not None else Config()

    @property
    def label_file(self) -> LabelFile:
        """The file of labels."""
        path = self.section.labels_file or state_dir(self.config) / "labels.jsonl"
        if self._labels is None or self._labels.path != path:
            self._labels = LabelFile(path)
        return self._labels

    def saved_file(self, kind: Kind) -> Path:
        """Return the file of `radard.config.saved` that the dashboard keeps."""
        return saved_file(self.config, kind)

    def now(self) -> dict[str, Any]:
        """Return state, panel, zones and playback at this moment."""
        host = self.host
        config = self.config
        settings = SavedSettings.model_validate(config, from_attributes=True)
        held = {"zones": config.zones.model_dump(mode="json"), "settings": settings.model_dump()}
        if host is None:
            return {"state": "starting", "reason": "", "panel": {}, **held, "playback": None}
        status, playback = host.health.status, host.playback()
        state = playback.state if playback is not None else None
        return {
            "state": status.state,
            "reason": status.reason,
            "panel": dict(host.panel()),
            **held,
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
            **{f"has_saved_{kind}": self.saved_file(kind).is_file() for kind in KINDS},
            "sensors": {**self._other_sensors(), **self.section.sensors},
            "has_store": self._store() is not None,
            "outputs": [
                {"name": s.name, "status": s.state.status, "reason": s.state.reason}
                for s in self._sinks()
            ],
        }

    def sensitivities(self) -> dict[str, Any]:
        """Return the sensitivities to choose from, and what each costs by the model's card."""
        config, hello = self.config, self.history.hello
        model, policy = hello.get("model"), hello.get("policy", "window")
        if config.model.name not in {AUTO_MODEL, "none"}:
            model = config.model.name
        card = None
        if model is not None:
            with contextlib.suppress(ModelMismatch, OSError, ValueError):
                card = read_card(model)
        alarm = config.alarm
        return {
            "choices": [asdict(each) for each in sensitivity_choices(alarm, policy, card)],
            # They go before those of the name.
            "given": [key for key in _NUMBERS if getattr(alarm, key) is not None],
        }

    def calibration(self) -> dict[str, Any] | None:
        """Return what the sensor's own calibration says of its room; None without one."""
        if self.config.gate.calibration == "none":
            return None
        try:
            found = load_calibration(kept_calibration(self.config))
        except ConfigError:
            return None
        return {
            "made_utc": found.provenance.made_utc,
            "false_gates_per_day": found.provenance.false_gates_per_day,
            "restless": restless_spans(found),
        }

    def config_shown(self) -> dict[str, Any]:
        """Return the configuration without secrets."""
        shown: dict[str, Any] = redact_value("", self.config.model_dump(mode="json"))
        return shown

    def health(self, *, is_whole: bool) -> Status:
        """Return the state of this sensor, or of all sensors of the process together."""
        of_all = self._of_all() if is_whole else ()
        hosts = [queries.host for queries in of_all or (self,) if queries.host is not None]
        if not hosts:
            return Status("starting", "")
        return overall({host.sensor: host.health for host in hosts})

    def metrics_text(self) -> str:
        """Return Prometheus' text, of all sensors of the process."""
        of_all = self._of_all() or (self,)
        for queries in of_all:
            if (host := queries.host) is not None:
                panel = host.panel()
                queries.metrics.refresh(
                    state=host.health.status.state,
                    is_armed=bool(panel.get("armed", True)),
                    driver=host.driver(),
                    drift=panel.get("clock_drift"),
                )
        return exposition([queries.metrics for queries in of_all], self._sinks())

    def _sinks(self) -> Sequence[Sink]:
        return self.host.sinks() if self.host is not None else ()

    def _other_sensors(self) -> dict[str, str]:
        """Return the other sensors of this process with the paths of their pages."""
        hosts = [queries.host for queries in self._of_all()]
        others = [host.sensor for host in hosts if host is not None and host is not self.host]
        return {name: f"/sensor/{name}/" for name in others}

    def why(self, seq: int) -> dict[str, Any] | None:
        """Return a decision and why it is so; None when it is not known any more."""
        records = self.history.around(seq)
        if not records:
            return None
        history = self.history
        known: tuple[str | None, ArmMode] = self.panels.get(seq) or (None, "away")
        panel, mode = known
        reasons = explain(records, history.hello, self.config, history.events(), panel, mode=mode)
        return {"decision": dict(records[-1]), **reasons}

    def events(self, wanted: EventFilter) -> list[dict[str, Any]]:
        """Return events, the newest first: of the store where there is one, else of this run."""
        labels = self.label_file.labels()
        found = [self._shown(e, labels) for e in self._all_events(wanted)]
        found = [e for e in found if _fits(e, wanted)]
        return found[: wanted.limit]

    def event(self, event_id: str) -> dict[str, Any] | None:
        """Return one event; None when it is not known."""
        if not _ULID.fullmatch(event_id):
            return None
        found = self.events(EventFilter(text=event_id, limit=1))
        return found[0] if found else None

    def clip(self, event_id: str) -> Path | None:
        """Return the clip of an event, if it is there and named by the event's own id."""
        event = self.event(event_id)
        path = Path(event["clip"]) if event and event["clip"] else None
        if path is None or path.name != f"{event_id}.h5" or not path.is_file():
            return None
        return path

    def picture(self, event_id: str) -> Path | None:
        """Return the picture that was made of an event's clip."""
        clip = self.clip(event_id)
        path = clip.with_suffix(".png") if clip is not None else None
        return path if path is not None and path.is_file() else None

    def _shown(self, event: Mapping[str, Any], labels: Mapping[str, str]) -> dict[str, Any]:
        clip = Path(event["clip"]) if event["clip"] else None
        return {
            **event,
            "has_clip": clip is not None and clip.is_file(),
            "has_picture": clip is not None and clip.with_suffix(".png").is_file(),
            "label": labels.get(event["id"]),
            "why": self.history.cause(event["id"]),
        }

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
        **{key: record[key] for key in _SAME},
        "sensor": sensor,
        "began": record["began"],
        "ended": record["time"] if record["phase"] == "end" else None,
        "reason": record["cause"],
        **{key: True for key in MARKS if key in record},
    }


def _of_store(event: StoredEvent) -> dict[str, Any]:
    return {
        **{key: getattr(event, key) for key in (*_SAME, "sensor", "reason")},
        "began": event.start_time,
        "ended": event.end_time,
        **({event.mark: True} if event.mark else {}),
    }


def _fits(event: Mapping[str, Any], wanted: EventFilter) -> bool:
    if wanted.kinds and event["kind"] not in wanted.kinds:
        return False
    if wanted.label and (event["label"] or "none") != wanted.label:
        return False
    return wanted.text.lower() in f"{event['reason']} {event['id']}".lower()
