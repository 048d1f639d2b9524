"""Metrics: counters of a run, and their Prometheus text form.

`Metrics` takes the same records as the sinks; `exposition` turns it, the states of the sinks and
what the driver counted into text. Names follow Prometheus' rules: one prefix, base units, `_total`
for counters. Powers stay in dB, relative to the sample unit of the module.
"""

import os
import resource
import threading
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from math import inf
from pathlib import Path

from radard.config.sink_table import KINDS
from radard.outputs.base import Host, Record, Sink
from x2radar import wall_clock

_BUCKETS = {
    # Latencies lie at 5 to 30 ms (docs/reference/outputs.md); late is up to a hop, 1 s.
    "radard_decision_latency_seconds": (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, inf),
    "radard_human_score": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, inf),
}
_STATES = ("starting", "online", "degraded", "offline")
_DRIVER = {
    "frames": "radard_frames_total",
    "lost": "radard_frames_dropped_total",
    "repeated": "radard_frames_dropped_total",
    "restarts": "radard_restarts_total",
    "damaged": "radard_wire_errors_total",
    "retries": "radard_command_retries_total",
    "reconnects": "radard_reconnects_total",
}
"""Metric of each field of `x2radar.RadarStats`; dropped frames have it as their reason."""
_GAUGES = {
    "power_db": "radard_residual_power_db",
    "noise_floor_db": "radard_noise_floor_db",
    "threshold_db": "radard_gate_threshold_db",
    "dropped": "radard_dwell_dropped_frames",
    "t_s": "radard_stream_seconds",
}
"""Metric of each key of the last decision."""
_ESCAPES = str.maketrans({"\\": r"\\", '"': r"\"", "\n": r"\n"})

Sample = tuple[str, Mapping[str, str], float]  # name, labels, value


class Metrics:
    """Counters of a run; one of several `sensors` labels all its samples with its name."""

    def __init__(self, sensor: str = "") -> None:
        self._own = {"sensor": sensor} if sensor else {}
        self._lock = threading.Lock()
        self._values: dict[tuple[str, tuple[tuple[str, str], ...]], float] = {}
        for name in _BUCKETS:
            self._observe(name, 0, n=0)
        for kind in KINDS:
            self._set("radard_event_active", 0, kind=kind)

    def on_record(self, record: Record) -> None:
        """Take a record, from any thread."""
        with self._lock:
            kind = record["type"]
            if kind == "decision":
                self._on_decision(record)
            elif kind == "event" and not record.get("test"):
                self._add("radard_events_total", kind=record["kind"], phase=record["phase"])
                self._set("radard_event_active", record["phase"] != "end", kind=record["kind"])
            elif kind == "hello":
                model, sensor = record["model"] or "none", record.get("sensor", "radar")
                about = {"version": record["version"], "model": model, "sensor": sensor}
                self._set("radard_build_info", 1, **about)
                self._set("radard_frame_rate_hertz", record["frame_rate_hz"])

    def refresh(self, host: Host) -> None:
        """Take what holds at this moment: a thread that hangs writes no record."""
        state, panel = host.health.status.state, host.panel()
        with self._lock:
            for each in _STATES:
                self._set("radard_state", state == each, state=each)
            self._set("radard_up", state in {"online", "degraded"})
            self._set("radard_armed", panel is None or panel.armed)
            for what, n in host.driver().items():
                if what in _DRIVER:
                    labels = {"reason": what} if what in {"lost", "repeated"} else {}
                    self._set(_DRIVER[what], n, **labels)
            if panel is not None and (drift := panel.clock_drift) is not None:
                self._set("radard_module_clock_drift_ratio", drift.ratio)
                self._set("radard_module_clock_drift_uncertainty_ratio", drift.uncertainty)

    def samples(self) -> list[Sample]:
        """Return all values of this moment, with name and labels."""
        with self._lock:
            return [(name, dict(labels), n) for (name, labels), n in self._values.items()]

    def _set(self, name: str, value: float, **labels: str) -> None:
        self._values[name, (*self._own.items(), *labels.items())] = value

    def _add(self, name: str, value: float = 1, **labels: str) -> None:
        key = (name, (*self._own.items(), *labels.items()))
        self._values[key] = self._values.get(key, 0) + value

    def _observe(self, name: str, value: float, n: int = 1) -> None:
        for limit in _BUCKETS[name]:
            label = "+Inf" if limit == inf else f"{limit:g}"
            self._add(f"{name}_bucket", n * (value <= limit), le=label)
        self._add(f"{name}_sum", n * value)
        self._add(f"{name}_count", n)

    def _on_decision(self, record: Record) -> None:
        label = record["label"] or "unknown"
        self._add("radard_decisions_total", gate=record["gate"], label=label)
        if (latency_ms := record["latency_ms"]) is not None:
            self._observe("radard_decision_latency_seconds", latency_ms / 1e3)
        if (score := record["fused_p_human"]) is not None:
            self._observe("radard_human_score", score)
        for key, name in _GAUGES.items():
            if record[key] is not None:
                self._set(name, record[key])
        self._set("radard_last_decision_timestamp_seconds", wall_clock.now_s())


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
    "radard_module_clock_drift_ratio": ("gauge", "Module's seconds per host's second, less one."),
    "radard_module_clock_drift_uncertainty_ratio": ("gauge", "Half of its 95 % interval."),
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


def exposition(metrics: Iterable[Metrics], sinks: Iterable[Sink] = ()) -> str:
    """Return what sensors, process and sinks tell in Prometheus' text format 0.0.4."""
    families: dict[str, list[str]] = {}
    own = [sample for each in metrics for sample in each.samples()]
    for name, labels, value in (*own, *_process_samples(), *_sink_samples(sinks)):
        inside = ",".join(f'{key}="{text.translate(_ESCAPES)}"' for key, text in labels.items())
        tail = f"{{{inside}}}" if inside else ""
        stems = (name.removesuffix(part) for part in ("_bucket", "_sum", "_count"))
        family = next((stem for stem in stems if stem in _BUCKETS), name)
        families.setdefault(family, []).append(f"{name}{tail} {float(value)!r}")
    parts = []
    for family, lines in families.items():
        kind, text = HELP[family]
        parts += [f"# HELP {family} {text}", f"# TYPE {family} {kind}", *lines]
    return "\n".join(parts) + "\n"


def _sink_samples(sinks: Iterable[Sink]) -> Iterator[Sample]:
    """Yield the states of the sinks; a second one of the same name gets a number."""
    seen: Counter[str] = Counter()
    for sink in sinks:
        seen[sink.name] += 1
        behind = f"#{n}" if (n := seen[sink.name]) > 1 else ""
        state, label = sink.state, {"sink": f"{sink.name}{behind}"}
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
