"""Metrics: counters of a run, and their Prometheus text form.

`Metrics` takes the same records as the sinks; `exposition` turns it, the states of the sinks and
what the driver counted into text. Names follow Prometheus' rules: one prefix, base units, `_total`
for counters. Powers stay in dB, relative to the sample unit of the module.
"""

import bisect
import os
import resource
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Any

from radard.config.sink_table import KINDS
from radard.outputs.base import Record, Sink
from radard.stream.clock_drift import Drift

# Buckets: latencies lie at 5 to 30 ms (docs/reference/outputs.md), late up to a hop, 1 s.
_LATENCY_S = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)
_SCORE = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_STATES = ("starting", "online", "degraded", "offline")
_DRIVER: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "frames": ("radard_frames_total", {}),
    "lost": ("radard_frames_dropped_total", {"reason": "lost"}),
    "repeated": ("radard_frames_dropped_total", {"reason": "repeated"}),
    "restarts": ("radard_restarts_total", {}),
    "damaged": ("radard_wire_errors_total", {}),
    "retries": ("radard_command_retries_total", {}),
    "reconnects": ("radard_reconnects_total", {}),
}
"""Metric and labels of each field of `x2radar.RadarStats`."""
_DRIFT = {
    "ratio": "radard_module_clock_drift_ratio",
    "uncertainty": "radard_module_clock_drift_uncertainty_ratio",
}
"""Metric of each field of `radard.stream.clock_drift.Drift`."""
_GAUGES = {
    "power_db": "radard_residual_power_db",
    "noise_floor_db": "radard_noise_floor_db",
    "threshold_db": "radard_gate_threshold_db",
    "dropped": "radard_dwell_dropped_frames",
    "t_s": "radard_stream_seconds",
}
"""Metric of each key of the last decision."""

Sample = tuple[str, Mapping[str, str], float]
"""Name, labels, value."""


class _Histogram:
    """Counts of values up to each limit."""

    def __init__(self, limits: Sequence[float]) -> None:
        self._limits = limits
        self._counts = [0] * (len(limits) + 1)
        self._total = 0.0

    def observe(self, value: float) -> None:
        self._counts[bisect.bisect_left(self._limits, value)] += 1
        self._total += value

    def samples(self, name: str) -> Iterator[Sample]:
        n = 0
        for limit, count in zip((*self._limits, None), self._counts, strict=True):
            n += count
            yield f"{name}_bucket", {"le": "+Inf" if limit is None else f"{limit:g}"}, n
        yield f"{name}_sum", {}, self._total
        yield f"{name}_count", {}, n


class Metrics:
    """Counters of a run; one of several `sensors` labels all its samples with its name."""

    def __init__(self, sensor: str = "") -> None:
        self._labels = {"sensor": sensor} if sensor else {}
        self._driver: Mapping[str, int] = {}
        self._drift: Mapping[str, float] = {}
        self._lock = threading.Lock()
        self._info: dict[str, str] = {}
        self._gauges: dict[str, float] = {}
        self._state = "starting"
        self._is_armed = True
        self._open: set[str] = set()
        self._decisions: Counter[tuple[str, str]] = Counter()
        self._events: Counter[tuple[str, str]] = Counter()
        self._latency = _Histogram(_LATENCY_S)
        self._score = _Histogram(_SCORE)

    def on_record(self, record: Record) -> None:
        """Take a record, from any thread."""
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
        self,
        *,
        state: str,
        is_armed: bool,
        driver: Mapping[str, int] | None = None,
        drift: Drift | None = None,
    ) -> None:
        """Take what holds at this moment: a thread that hangs writes no record.

        `driver` is what the driver has counted, by the names of `x2radar.RadarStats`, `drift` a
        `radard.stream.clock_drift.Drift`.
        """
        self._drift = asdict(drift) if drift is not None else {}
        self._state, self._is_armed = state, is_armed
        self._driver = driver or {}

    def samples(self) -> Iterator[Sample]:
        """Yield what holds now."""
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
            for each in KINDS:
                yield "radard_event_active", {"kind": each}, each in self._open
            for (gate, label), n in sorted(self._decisions.items()):
                yield "radard_decisions_total", {"gate": gate, "label": label}, n
            for (kind, phase), n in sorted(self._events.items()):
                yield "radard_events_total", {"kind": kind, "phase": phase}, n
            for name, value in sorted(self._gauges.items()):
                yield name, {}, value
            yield from self._latency.samples("radard_decision_latency_seconds")
            yield from self._score.samples("radard_human_score")
        for what, value in sorted(self._drift.items()):
            yield _DRIFT[what], {}, value
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
        for key, name in _GAUGES.items():
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
    "radard_module_clock_drift_ratio": (
        "gauge",
        "Seconds of the module's frame clock per second of the host's, less one.",
    ),
    "radard_module_clock_drift_uncertainty_ratio": (
        "gauge",
        "Half of its 95 % interval; without the host's own error.",
    ),
    "radard_reconnects_total": ("counter", "Times that a lost device was opened again."),
    "radard_process_cpu_seconds_total": ("counter", "Processor time of the daemon, all threads."),
    "radard_process_resident_memory_bytes": ("gauge", "Memory of the daemon."),
    "radard_process_open_fds": ("gauge", "Open files and connections of the daemon."),
    "radard_process_threads": ("gauge", "Threads of the daemon."),
    "radard_sink_ok": ("gauge", "1 unless the sink's last attempt failed."),
    "radard_sink_waiting_records": ("gauge", "Records that wait in a sink."),
    "radard_sink_sent_records_total": ("counter", "Records handed on."),
    "radard_sink_dropped_records_total": ("counter", "Records given up."),
    "radard_sink_failures_total": ("counter", "Attempts that failed."),
}
"""Type and help text of every metric."""


def _sink_samples(sinks: Iterable[Sink]) -> Iterator[Sample]:
    """Yield the states of the sinks; a second one of the same name gets a number."""
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


def _process_samples() -> Iterator[Sample]:
    """Yield what the process uses; Linux alone tells memory, files and threads."""
    times = os.times()
    yield "radard_process_cpu_seconds_total", {}, times.user + times.system
    own = Path("/proc/self")
    try:
        n_pages = int((own / "statm").read_text().split()[1])
        n_fds = len(list((own / "fd").iterdir())) - 1  # less the listing's own
        n_threads = len(list((own / "task").iterdir()))
    except OSError:
        return
    yield "radard_process_resident_memory_bytes", {}, n_pages * resource.getpagesize()
    yield "radard_process_open_fds", {}, n_fds
    yield "radard_process_threads", {}, n_threads


def exposition(metrics: Iterable[Metrics], sinks: Iterable[Sink] = ()) -> str:
    """Return what sensors, process and sinks tell in Prometheus' text format 0.0.4."""
    families: dict[str, list[str]] = {}
    own = chain.from_iterable(each.samples() for each in metrics)
    for name, labels, value in (*own, *_process_samples(), *_sink_samples(sinks)):
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
