"""The outlets of `-o lsl:`, read with pylsl; in processes of their own, kept to this machine."""

import json
import math
import uuid

import pytest

from radard.outputs.lsl import CHANNELS
from tests.processes import ran

pytestmark = pytest.mark.integration

_PROGRAM = """
import json, sys, time
import pylsl
from radard.config.sink_table import SinkOptions
from radard.outputs.base import SinkContext
from radard.outputs.registry import close_sinks, make_output

output, records = sys.argv[1], json.loads(sys.argv[2])
name = output.partition(":")[2] or "radard-hall-simulated"
sink = make_output(output, SinkOptions(), SinkContext(sensor="hall", mark="simulated"))
sink.start()
inlets = []
for stream in (name, name + "-events"):
    found = pylsl.resolve_byprop("name", stream, timeout=60)
    inlets.append(pylsl.StreamInlet(found[0]))
    inlets[-1].open_stream(60)
before_s = pylsl.local_clock()
for record in records:
    sink.write(record)
n = sum(r["type"] == "decision" for r in records)
samples = [inlets[0].pull_sample(timeout=60) for _ in range(n)]
event, _ = inlets[1].pull_sample(timeout=60)
labels = inlets[0].info(60).get_channel_labels()
print(json.dumps({
    "samples": [s for s, _ in samples], "ages": [before_s - t for _, t in samples],
    "event": event[0], "labels": labels, "rate": inlets[0].info(60).nominal_srate(),
    "types": [i.info(60).type() for i in inlets], "state": sink.state.status,
}))
for inlet in inlets:
    inlet.close_stream()
close_sinks([sink])
"""


def decision(**changes):
    own = dict.fromkeys(CHANNELS)
    own |= {"type": "decision", "gate": "closed", "alarm": False, "latency_ms": None}
    own |= {"power_db": -40.5, "threshold_db": -30.25}
    return own | changes


OPEN = decision(
    gate="open",
    alarm=True,
    latency_ms=2500.0,
    **{name: 0.125 for name in CHANNELS if "p_" in name},
    range_m=2.5,
)
INVALID = decision(gate="invalid", power_db=None, threshold_db=None)
EVENT = {"type": "event", "id": "01H", "kind": "alarm", "phase": "new"}
STATUS = {"type": "status", "state": "online", "reason": ""}


@pytest.mark.parametrize("is_named", [True, False])
def test_pylsl_receives_decisions_and_events(tmp_path, monkeypatch, is_named):
    config = tmp_path / "lsl_api.cfg"
    session = uuid.uuid4().hex
    config.write_text(
        f"[lab]\nSessionID = {session}\n[multicast]\nResolveScope = machine\n[log]\nlevel = -1\n"
    )
    monkeypatch.setenv("LSLAPICFG", str(config))
    records = [STATUS, OPEN, decision(), INVALID, EVENT]
    output = "lsl:lab" if is_named else "lsl:"
    done = ran("-c", _PROGRAM, output, json.dumps(records))
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["labels"] == list(CHANNELS)
    assert told["types"] == ["Radar", "Markers"]
    assert told["rate"] == 1.0
    assert told["state"] == "ok"
    assert json.loads(told["event"]) == EVENT
    first, second, third = told["samples"]
    assert first == [1.0, 1.0, *[0.125] * 6, -40.5, -30.25, 2.5]
    assert second[:2] == [0.0, 0.0]
    assert all(map(math.isnan, [*second[2:8], second[10], *third]))
    # Its frame had come in 2.5 s before it was written.
    assert 0 < told["ages"][0] <= 2.5
    assert told["ages"][1] < 0


def test_a_run_says_nothing_of_the_library(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    argv = ["--port", "sim:empty", "--speed", "max", "--duration", "3", "-o", "lsl:", "-o", "json"]
    done = ran("-m", "radard", *argv)
    assert (done.returncode, done.stderr) == (0, "")
    assert '"type":"decision"' in done.stdout
