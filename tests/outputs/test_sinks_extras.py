"""Outputs of extras: messages by Apprise to a real receiver, outlets of LSL read with pylsl."""

import base64
import json
import math
import uuid

import pytest

from radard.errors import ConfigError, UsageError
from radard.outputs.apprise import message_of
from radard.outputs.lsl import CHANNELS
from tests import web_helpers
from tests.processes import ran
from tests.sink_helpers import decision, event, status
from tests.waiting import wait_for

pytestmark = pytest.mark.integration

TOKEN = "t0ken"  # noqa: S105 - of nothing


@pytest.fixture
def sink(server, opened):
    own = f"apprise:json://user:{TOKEN}@127.0.0.1:{server.port}/{TOKEN}"
    return lambda url=own, **section: opened(url, apprise=section)


def posted(server, n=1):
    wait_for(lambda: len(server.posts) >= n)
    return [json.loads(body) for _, _, body in server.posts]


@pytest.mark.parametrize("is_late", [False, True])
def test_an_alarm_in_words_with_a_picture_that_may_come_later(server, sink, tmp_path, is_late):
    made, picture = sink(), tmp_path / "clip.png"
    if not is_late:
        picture.write_bytes(b"\x89PNG picture")
    made.write({**event(2), "clip": str(tmp_path / "clip.h5"), "simulated": True})
    if is_late:
        wait_for(lambda: made.state.busy_s > 0)
        picture.write_bytes(b"\x89PNG picture")
    (message,) = posted(server)
    assert message["title"] == "hall: alarm (simulated)"
    assert message["message"].startswith("human at 2.0 m\n2026-11-21T06:00:02")
    assert message["type"] == "failure"
    (attached,) = message["attachments"]
    assert base64.b64decode(attached["base64"]) == b"\x89PNG picture"


def test_without_a_picture_the_alarm_goes_all_the_same(server, sink, tmp_path, monkeypatch):
    monkeypatch.setattr("radard.outputs.apprise._PICTURE_S", 0.1)
    (tmp_path / "there.png").write_bytes(b"not wanted")
    sink().write({**event(1), "clip": str(tmp_path / "never.h5")})
    posted(server)
    sink(picture=False).write({**event(2), "clip": str(tmp_path / "there.h5")})
    assert [m["attachments"] for m in posted(server, 2)] == [[], []]


def test_no_secret_is_told_however_much_is_logged(server):
    server.code = 404
    url = f"json://user:{TOKEN}@127.0.0.1:{server.port}/{TOKEN}"
    run = ["--port", "sim:human", "--speed", "max", "--duration", "6", "-vv"]
    done = ran("-m", "radard", *run, "-o", "null", "-o", f"apprise:{url}", check=True)
    assert server.posts
    assert "apprise:json: the service answers 404" in done.stderr
    assert TOKEN not in done.stdout + done.stderr


def test_a_url_from_a_file(server, sink, tmp_path):
    (tmp_path / "url").write_text(f"json://127.0.0.1:{server.port}/{TOKEN}\n")
    sink(f"apprise:@{tmp_path / 'url'}").write(event(1))
    assert posted(server)[0]["title"] == "hall: alarm"
    assert server.posts[0][0] == f"/{TOKEN}"
    with pytest.raises(ConfigError, match=r"apprise.url_file: .*No such file"):
        sink(f"apprise:@{tmp_path / 'none'}")


@pytest.mark.parametrize("rest", ["nothing", f"odd://{TOKEN}", "tgram://", f"tgram://{TOKEN}"])
def test_what_is_no_url_is_one_line_without_secrets(sink, rest):
    with pytest.raises(UsageError, match="no URL that Apprise knows") as caught:
        sink(f"apprise:{rest}")
    assert TOKEN not in str(caught.value)


def test_a_test_alarm_and_a_sensor_of_several_are_named():
    title, _ = message_of({**event(1), "test": True, "sensor": "attic"}, "radard")
    assert title == "attic: alarm (test)"
    assert message_of(event(1, kind="tamper", phase="end"), "hall")[0] == "hall: tamper end"


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


CHANCES = {name: 0.125 for name in CHANNELS if "p_" in name}
OPEN = decision(latency_ms=2500.0, power_db=-40.5, threshold_db=-30.25, range_m=2.5, **CHANCES)
CLOSED = web_helpers.decision(latency_ms=None)
INVALID = CLOSED | {"gate": "invalid", "power_db": None, "threshold_db": None}


@pytest.mark.parametrize("is_named", [True, False])
def test_pylsl_receives_decisions_and_events(tmp_path, monkeypatch, is_named):
    config = tmp_path / "lsl_api.cfg"
    session = uuid.uuid4().hex
    lines = ("[lab]", f"SessionID = {session}", "[multicast]", "ResolveScope = machine")
    config.write_text("\n".join((*lines, "[log]", "level = -1\n")))
    monkeypatch.setenv("LSLAPICFG", str(config))
    records = [status("online"), OPEN, CLOSED, INVALID, event()]
    done = ran("-c", _PROGRAM, "lsl:lab" if is_named else "lsl:", json.dumps(records))
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["labels"], told["types"]) == (list(CHANNELS), ["Radar", "Markers"])
    assert (told["rate"], told["state"], json.loads(told["event"])) == (1.0, "ok", event())
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
