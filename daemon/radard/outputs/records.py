"""Decisions, events and states to the records of the JSON Lines contract.

The contract is radard's `output.schema.json`. Wall-clock fields are `time`,
`latency_ms` and all of `hello`; everything else is the same in every replay.
"""

import time
from collections.abc import Mapping, Sequence
from typing import Any

from radard.alarm.events import Event
from radard.config.config import Config
from radard.config.credentials import redact
from radard.health.health import Status
from radard.judge.bundle import CLASSES
from radard.judge.classifier import Probabilities
from radard.judge.decision import Decision, pet_limit_of
from radard.pipeline import Pipeline
from x2radar.command import installed_version
from x2radar.wall_clock import utc_text

SCHEMA = 1  # of output.schema.json
_OF_AXIS = ("kind", "n_range", "bin_length_m", "range_offset_m", "carrier_hz")
_LEVELS = ("power_db", "noise_floor_db", "threshold_db")
Record = dict[str, Any]


def hello_record(
    pipeline: Pipeline, config: Config, *, is_armed: bool, taken: Sequence[str] = ()
) -> Record:
    """Return the first line of a run; `taken` is what comes from files that nobody named."""
    bundle = pipeline.classifier.bundle if pipeline.classifier else None
    axis = pipeline.stream.axis
    return {
        "type": "hello",
        "schema": SCHEMA,
        "version": installed_version(),
        "time": utc_text(),
        "sensor": config.sensor.name,
        "port": redact(config.sensor.port or ""),
        "device": pipeline.stream.device,
        "model": bundle.name if bundle else None,
        "policy": pipeline.policy,
        "pet_limit": pet_limit_of(config, bundle),
        "frame_rate_hz": pipeline.stream.frame_rate_hz,
        **{name: getattr(axis, name) for name in _OF_AXIS},
        "dwell_frames": pipeline.shape.n_slow,
        "hop_s": pipeline.shape.hop_s,
        "armed": is_armed,
        "sensitivity": config.alarm.sensitivity,
        "config_hash": config.digest(),
        "taken": list(taken),
    }


def decision_record(decision: Decision) -> Record:
    """Return the line of one decision; `latency_ms` ends at this call."""
    r = decision.reading
    is_open = decision.gate == "open"
    latency_ms = (time.monotonic() - decision.t_mono_s) * 1e3 if decision.t_mono_s else None
    return {
        "type": "decision",
        "seq": decision.seq,
        "t_s": round(decision.t_s, 3),
        "time": utc_text(),
        "gate": decision.gate,
        **{name: _round(getattr(r, name), 2) if r else None for name in _LEVELS},
        **_probabilities("p_", decision.window),
        **_probabilities("fused_p_", decision.fused),
        "label": decision.label,
        "alarm": decision.alarm,
        "range_m": _round(r.range_m, 3) if r and is_open else None,
        "tracks": [
            {
                "id": track.id,
                "range_m": _round(track.range_m, 3),
                "radial_velocity_mps": _round(track.radial_velocity_mps, 2),
                **_probabilities("p_", track.window),
            }
            for track in decision.tracks
        ],
        "frames": decision.frames,
        "dropped": decision.dropped,
        "latency_ms": _round(latency_ms, 2) if latency_ms is not None else None,
    }


def event_record(event: Event) -> Record:
    """Return the line of one phase of an event."""
    return {
        "type": "event",
        "id": event.id,
        "phase": event.phase,
        "kind": event.kind,
        "t_s": round(event.t_s, 3),
        "time": utc_text(),
        "start_t_s": round(event.start_t_s, 3),
        "end_t_s": _round(event.end_t_s, 3) if event.end_t_s is not None else None,
        "peak": round(event.peak, 4),
        "reason": event.reason,
        "clip": event.clip,
        **({"test": True} if event.is_trial else {}),
    }


def ended_record(record: Mapping[str, Any]) -> Record:
    """Return the line of the end of an event that a run before this one has left."""
    now = {"phase": "end", "t_s": 0.0, "time": utc_text(), "start_t_s": 0.0, "end_t_s": 0.0}
    return {**record, **now, "reason": f"{record['reason']}; a new run has begun"}


def status_record(status: Status) -> Record:
    """Return the line of a state."""
    return {"type": "status", "state": status.state, "reason": status.reason}


def marked(record: Record, mark: str) -> Record:
    """Return a record, no decision, that says 'simulated' or 'replayed'; '' says nothing."""
    return {**record, mark: True} if mark and record["type"] != "decision" else record


def _probabilities(prefix: str, p: Probabilities | None) -> Record:
    return {f"{prefix}{name}": _round(getattr(p, name), 4) if p else None for name in CLASSES}


def _round(value: float, digits: int) -> float:
    # + 0.0 turns -0.0 into 0.0, which would read as another value in a comparison.
    return round(value, digits) + 0.0
