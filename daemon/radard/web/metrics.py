"""Metrics: counters of a run, and their Prometheus text form.

`Metrics` is fed with the same records as the sinks and holds plain numbers; `exposition`
turns it, the states of the sinks and what the driver counted into text. Names follow
Prometheus' rules: one prefix, base units, `_total` for what only grows. Powers stay in dB,
relative to a unit that only the recording knows.
"""

import bisect
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from radard.sinks.base import Record, Sink

_LATENCY_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)
_SCORE = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_STATES = ("starting", "online", "degraded", "offline")
_KINDS = ("alarm", "fault", "tamper")

_DRIVER: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "frames": ("radard_frames_total", {}),
    "lost": ("radard_frames_dropped_total", {"reason": "lost"}),
    "repeated": ("radard_frames_dropped_total", {"reason": "repeated"}),
    "restarts": ("radard_restarts_total", {}),
    "damaged": ("radard_wire_errors_total", {}),
    "retries": ("radard_command_retries_total", {}),
    "reconnects": ("radard_reconnects_total", {}),
}

Sample = tuple[str, Mapping[str, str], float]


@dataclass(slots=True)
class Histogram:
    """Counts of values up to each limit, as Prometheus wants them."""

    limits: Sequence[float]
    counts: list[int] = field(default_factory=list)
    total: float = 0.0

    def __post_init__(self) -> None:
        self.counts = [0] * (len(self.limits) + 1)

    def observe(self, value: float) -> None:
        """Count a value."""
        self.counts[bisect.bisect_left(self.limits, value)] += 1
        self.total += value

    def samples(self, name: str) -> Iterator[Sample]:
        """Yield the samples under a metric's name."""
        n = 0
        for limit, count in zip((*self.limits, None), self.counts, strict=True):
            n += count
            yield f"{name}_bucket", {"le": "+Inf" if limit is None else f"{limit:g}"}, n
        yield f"{name}_sum", {}, self.total
        yield f"{name}_count", {}, n


class Metrics:
    """Counters of a run; `on_record` takes what the sinks take, from any thread.

    Parameters
    ----------
    sensor : str
        Label of all samples, for one of several sensors; empty: no such label.
    """

    def __init__(self, sensor: str = "") -> None:
        self._labels = {"sensor": sensor} if sensor else {}
        self._driver: Mapping[str, int] = {}
        self._lock = threading.Lock()
        self._info: dict[str, str] = {}
        self._gauges: dict[str, float] = {}
        self._state = "starting"
        self._is_armed = True
        self._open: set[str] = set()
        self._decisions: Counter[tuple[str, str]] = Counter()
        self._events: Counter[tuple[str, str]] = Counter()
        self._latency = Histogram(_LATENCY_S)
        self._score = Histogram(_SCORE)

    def on_record(self, record: Record) -> None:
        """Take a record."""
        with self._lock:
            kind = record["type"]
            if kind == "decision":
                self._on_decision(record)
            elif kind == "event":
                self._events[record["kind"], record["phase"]] += 1
                self._open.discard(record["kind"])
                if record["phase"] != "end":
                    self._open.add(record["kind"])
            elif kind == "status":
                self._state = record["state"]
            elif kind == "hello":
                self._info = {
                    "version": str(record["version"]),
                    "model": str(record["model"] or "none"),
                    "sensor": str(record.get("sensor", "radar")),
                }
                self._gauges["radard_frame_rate_hertz"] = record["frame_rate_hz"]
                self._is_armed = bool(record.get("armed", True))

    def refresh(
        self, *, state: str, is_armed: bool, driver: Mapping[str, int] | None = None
    ) -> None:
        """Note what holds at this moment, whether or not a record said so.

        Parameters
        ----------
        state : str
            Of the sensor's health; a thread that hangs writes no record.
        is_armed : bool
            As the last command said.
        driver : mapping of str to int, optional
            What the driver has counted since its start, by the names of `x2radar.RadarStats`.
        """
        self._state, self._is_armed = state, is_armed
        self._driver = driver or {}

    def samples(self) -> Iterator[Sample]:
        """Yield what holds now: name, labels, value."""
        for name, labels, value in self._samples():
            yield name, {**self._labels, **labels}, value

    def _samples(self) -> Iterator[Sample]:
        with self._lock:
            if self._info:
                yield "radard_build_info", dict(self._info), 1
            for state in _STATES:
                yield "radard_state", {"state": state}, self._state == state
            yield "radard_up", {}, self._state in {"online", "degraded"}
            yield "radard_armed", {}, self._is_armed
            for kind in _KINDS:
                yield "radard_event_active", {"kind": kind}, kind in self._open
            for (gate, label), n in sorted(self._decisions.items()):
                yield "radard_decisions_total", {"gate": gate, "label": label}, n
            for (kind, phase), n in sorted(self._events.items()):
                yield "radard_events_total", {"kind": kind, "phase": phase}, n
            for name, value in sorted(self._gauges.items()):
                yield name, {}, value
            yield from self._latency.samples("radard_decision_latency_seconds")
            yield from self._score.samples("radard_human_score")
        for what, n in sorted(self._driver.items()):
            if what in _DRIVER:
                name, labels = _DRIVER[what]
                yield name, labels, n

    def _on_decision(self, record: Record) -> None:
        self._decisions[record["gate"], record["label"] or "unknown"] += 1
        if record["latency_ms"] is not None:
            self._latency.observe(record["latency_ms"] / 1e3)
        if record["fused_p_human"] is not None:
            self._score.observe(record["fused_p_human"])
        for name, key in (
            ("radard_residual_power_db", "power_db"),
            ("radard_noise_floor_db", "noise_floor_db"),
            ("radard_gate_threshold_db", "threshold_db"),
            ("radard_dwell_dropped_frames", "dropped"),
            ("radard_stream_seconds", "t_s"),
        ):
            if record[key] is not None:
                self._gauges[name] = record[key]
        self._gauges["radard_last_decision_timestamp_seconds"] = time.time()


HELP = {
    "radard_build_info": ("gauge", "Version and model; always 1."),
    "radard_state": ("gauge", "1 for the state that holds."),
    "radard_up": ("gauge", "1 while decisions are made from fresh frames."),
    "radard_armed": ("gauge", "1 while armed."),
    "radard_event_active": ("gauge", "1 while an event of this kind is on."),
    "radard_decisions_total": ("counter", "Decisions by gate and label."),
    "radard_events_total": ("counter", "Phases of events."),
    "radard_frame_rate_hertz": ("gauge", "Frames per second of the stream."),
    "radard_residual_power_db": ("gauge", "Power after clutter removal, last decision."),
    "radard_noise_floor_db": ("gauge", "Noise floor, last decision."),
    "radard_gate_threshold_db": ("gauge", "What the power must exceed."),
    "radard_dwell_dropped_frames": ("gauge", "Frames missing in the last dwell."),
    "radard_stream_seconds": ("gauge", "Stream time of the last decision."),
    "radard_last_decision_timestamp_seconds": ("gauge", "When the last decision was made."),
    "radard_decision_latency_seconds": ("histogram", "From a dwell's last frame to its decision."),
    "radard_human_score": ("histogram", "Fused probability of a human while the gate is open."),
    "radard_frames_total": ("counter", "Frames that arrived."),
    "radard_frames_dropped_total": ("counter", "Frames that did not arrive, or came twice."),
    "radard_restarts_total": ("counter", "Restarts of the module."),
    "radard_wire_errors_total": ("counter", "Damaged stretches of bytes."),
    "radard_command_retries_total": ("counter", "Commands to the module sent again."),
    "radard_reconnects_total": ("counter", "Times that a lost device was opened again."),
    "radard_sink_ok": ("gauge", "1 unless the sink's last attempt failed."),
    "radard_sink_waiting_records": ("gauge", "Records that wait in a sink."),
    "radard_sink_sent_records_total": ("counter", "Records handed on."),
    "radard_sink_dropped_records_total": ("counter", "Records given up."),
    "radard_sink_failures_total": ("counter", "Attempts that failed."),
}
"""Type and help text of every metric."""


def sink_samples(sinks: Iterable[Sink]) -> Iterator[Sample]:
    """Yield the states of the sinks; two of the same name are told apart by a number."""
    seen: Counter[str] = Counter()
    for sink in sinks:
        seen[sink.name] += 1
        n = seen[sink.name]
        state, label = sink.state, {"sink": sink.name if n == 1 else f"{sink.name}#{n}"}
        yield "radard_sink_ok", label, state.is_ok
        yield "radard_sink_waiting_records", label, state.n_waiting
        yield "radard_sink_sent_records_total", label, state.n_sent
        yield "radard_sink_dropped_records_total", label, state.n_dropped
        yield "radard_sink_failures_total", label, state.n_failures


def exposition(metrics: Iterable[Metrics], sinks: Iterable[Sink] = ()) -> str:
    """Return all samples in Prometheus' text format 0.0.4.

    Parameters
    ----------
    metrics : iterable of Metrics
        Of every sensor.
    sinks : iterable of Sink
        Whose states to add.

    Returns
    -------
    str
        For `Content-Type: text/plain; version=0.0.4`.
    """
    families: dict[str, list[str]] = {}
    own = chain.from_iterable(each.samples() for each in metrics)
    for name, labels, value in (*own, *sink_samples(sinks)):
        families.setdefault(_family(name), []).append(_line(name, labels, value))
    parts = []
    for family, lines in families.items():
        kind, text = HELP[family]
        parts += [f"# HELP {family} {text}", f"# TYPE {family} {kind}", *lines]
    return "\n".join(parts) + "\n"


def _family(name: str) -> str:
    for tail in ("_bucket", "_sum", "_count"):
        if name.endswith(tail) and name.removesuffix(tail) in HELP:
            return name.removesuffix(tail)
    return name


def _line(name: str, labels: Mapping[str, Any], value: float) -> str:
    inside = ",".join(f'{key}="{_escaped(str(text))}"' for key, text in labels.items())
    return f"{name}{{{inside}}} {float(value)!r}" if inside else f"{name} {float(value)!r}"


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
