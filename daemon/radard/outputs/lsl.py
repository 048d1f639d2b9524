"""Lab Streaming Layer: decisions and events beside other instruments, on one clock.

NAME, of type Radar, has a sample of float32 a decision, NaN where it holds nothing; NAME-events,
of type Markers, every phase of every event as JSON. https://labstreaminglayer.readthedocs.io
"""

import math
import os
from pathlib import Path
from typing import Any

from radard.config.sink_table import SinkOptions
from radard.judge.bundle import PROBABILITIES
from radard.outputs.base import Record, SinkContext
from radard.outputs.stdout import json_line
from radard.outputs.thread_sink import DirectSink
from x2radar.backoff import Backoff
from x2radar.extras import needed

CHANNELS = ("alarm", "gate_open", *PROBABILITIES, "power_db", "threshold_db", "range_m")
"""Of a sample, in order; alarm and gate_open are 0 or 1, NaN in a window that is invalid."""
_QUIET = "[log]\nlevel = -1\n"  # warnings and errors; liblsl greets on stderr otherwise
_CONFIGS = ("lsl_api.cfg", "~/lsl_api/lsl_api.cfg", "/etc/lsl_api/lsl_api.cfg")
"""Where liblsl looks for a configuration, behind the variable LSLAPICFG."""


class LslSink(DirectSink):
    """Publishes decisions and events for `lsl:NAME`; raises MissingExtra without pylsl."""

    def __init__(self, url: str, _options: SinkOptions, context: SinkContext) -> None:
        name = url.partition(":")[2] or f"radard-{context.marked_sensor}"
        self._lsl = needed("pylsl", what=f"--output lsl:{name}")
        super().__init__(f"lsl:{name}", Backoff(1.0, 10.0, name), kinds={"decision", "event"})
        self._stream = name
        self._source = f"radard {context.marked_sensor} {name}"
        host = context.host
        self._rate_hz = 1 / host.config().decision.hop_s if host is not None else 1.0
        self._decisions: Any = None
        self._events: Any = None

    def _begin(self) -> None:
        configs = (os.environ.get("LSLAPICFG", ""), *_CONFIGS)
        if not any(Path(path).expanduser().is_file() for path in configs):
            # Without effect once the library is at work in this process.
            self._lsl.set_config_content(_QUIET)
        info = self._info("", "Radar", len(CHANNELS), self._rate_hz, "float32")
        info.set_channel_labels(list(CHANNELS))
        self._decisions = self._lsl.StreamOutlet(info)
        self._events = self._lsl.StreamOutlet(self._info("-events", "Markers", 1, 0.0, "string"))

    def _info(self, behind: str, kind: str, n: int, rate_hz: float, form: str) -> Any:
        name, source = f"{self._stream}{behind}", f"{self._source}{behind}"
        return self._lsl.StreamInfo(name, kind, n, rate_hz, form, source)

    def _deliver(self, record: Record) -> None:
        now_s = self._lsl.local_clock()
        if record["type"] == "event":
            self._events.push_sample([json_line(record).rstrip()], now_s)
            return
        told = {**record, "gate_open": record["gate"] == "open"}
        if record["gate"] == "invalid":
            told |= {"alarm": None, "gate_open": None}
        sample = [math.nan if told[name] is None else float(told[name]) for name in CHANNELS]
        self._decisions.push_sample(sample, now_s - (record["latency_ms"] or 0) / 1e3)

    def _shut(self) -> None:
        # Their destructors end the streams.
        self._decisions = self._events = None


open_from_url = LslSink
