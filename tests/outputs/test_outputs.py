"""From the configuration to the sinks: names, options, state directory, reload."""

import json

import pytest

from radard.config.config import Config, load_config
from radard.log_file import read_events
from radard.outputs.fanout import Outputs
from radard.outputs.registry import start_sink
from tests.host_helpers import FakeHost
from tests.sink_helpers import event, hello, ulid
from tests.waiting import wait_for

pytestmark = pytest.mark.integration


def configured(tmp_path, server, port="/dev/nothing", **webhook):
    return load_config(
        environ={},
        options={
            "sensor": {"name": "hall", "port": port},
            "service": {"state_dir": tmp_path},
            "log": {"first_retry_s": 0.02, "longest_retry_s": 0.05},
            "webhook": webhook,
            "output": [f"webhook:http://127.0.0.1:{server.port}/"],
        },
    )


def outputs():
    out = Outputs(stdout_is_terminal=False)
    out.add(FakeHost("hall"))
    return out


def bodies(server):
    return [json.loads(body) for _, _, body in list(server.posts)]


def test_changed_options_hold_after_a_reload_and_no_event_is_lost(tmp_path, server):
    server.code = 500
    out = outputs()
    out.open(configured(tmp_path, server))
    out.put(event(1, kind="fault"))
    wait_for(lambda: server.posts)
    out.reload(configured(tmp_path, server, kinds=["alarm"]), [hello()])
    out.put(event(2, kind="fault"))
    out.put(event(3))
    server.code = 200
    wait_for(lambda: ulid(3) in {b["id"] for b in bodies(server)})
    out.close()
    assert {b["id"] for b in bodies(server)} == {ulid(1), ulid(3)}


def test_a_sink_goes_on_until_the_one_that_replaces_it_can_be_opened(
    tmp_path, server, caplog, monkeypatch
):
    monkeypatch.setattr("radard.outputs.fanout._RETRY_S", 0.0)
    secret, out = tmp_path / "secret", outputs()
    good = configured(tmp_path, server)
    out.open(good)
    bad = configured(tmp_path, server, secret_file=str(secret), phases=["new"])
    for _ in range(2):
        out.reload(bad, [hello()])
        out.retry()
    ((_, name), why), *more = out.faults.items()
    assert not more
    assert name == f"webhook:http://127.0.0.1:{server.port}"
    assert "webhook.secret_file" in why
    assert len([r for r in caplog.records if "secret_file" in r.getMessage()]) == 2
    out.put(event(1, phase="update"))
    wait_for(lambda: len(server.posts) == 1)
    secret.write_text("shared\n")
    out.retry()
    assert out.faults == {}
    out.put(event(2, phase="update"))
    out.put(event(3))
    wait_for(lambda: len(server.posts) == 2)
    out.close()
    assert [b["id"] for b in bodies(server)] == [ulid(1), ulid(3)]
    assert "webhook-signature" in server.posts[-1][1]


def test_undoing_a_change_that_could_not_be_opened_is_no_fault(tmp_path, server):
    out = outputs()
    good = configured(tmp_path, server)
    out.open(good)
    before = out.sinks
    out.reload(configured(tmp_path, server, ca_file="/nowhere/x"), [hello()])
    assert out.faults
    out.reload(good, [hello()])
    assert (out.faults, out.sinks) == ({}, before)
    out.close()


def test_records_wait_for_an_output_that_is_added_and_cannot_be_opened_yet(
    tmp_path, server, monkeypatch
):
    monkeypatch.setattr("radard.outputs.fanout._RETRY_S", 0.0)
    out = outputs()
    config = configured(tmp_path, server)
    out.open(config)
    file = tmp_path / "later" / "x.jsonl"
    out.reload(config.model_copy(update={"output": (f"json:{file}",)}), [hello()])
    out.put(event(1))
    file.parent.mkdir()
    out.retry()
    out.close()
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    assert [line["type"] for line in lines] == ["hello", "event"]


def test_what_only_memory_holds_outlives_a_reload(tmp_path, server):
    (tmp_path / "log.db").mkdir()
    server.code = 500
    out = outputs()
    out.open(configured(tmp_path, server))
    out.put(event(1))
    wait_for(lambda: server.posts)
    out.reload(configured(tmp_path, server, timeout_s=9.0), [hello()])
    server.code = 200
    wait_for(lambda: out.sinks[0][1].state.n_sent == 1)
    out.close()
    assert {b["id"] for b in bodies(server)} == {ulid(1)}


def test_only_what_changed_is_reopened(tmp_path, server):
    out = outputs()
    config = configured(tmp_path, server)
    more = (*config.output, f"json:{tmp_path / 'a.jsonl'}", f"store:{tmp_path / 'a.db'}")
    config = config.model_copy(update={"output": more})
    out.open(config)
    before = [sink for _, sink in out.sinks]
    out.put(hello())
    store = config.store.model_copy(update={"decisions": False})
    out.reload(config.model_copy(update={"store": store}), [hello(sensitivity="low")])
    after = [sink for _, sink in out.sinks]
    assert [a is b for a, b in zip(before, after, strict=True)] == [True, True, False]
    out.put(event(1))
    out.close()
    lines = (tmp_path / "a.jsonl").read_text().splitlines()
    assert [json.loads(line)["type"] for line in lines] == ["hello", "hello", "event"]
    assert [e.id for e in read_events(tmp_path / "a.db")] == [ulid(1)]


def test_what_comes_while_an_output_is_reopened_waits_for_it(tmp_path, server, monkeypatch):
    out = outputs()
    config = configured(tmp_path, server)
    file, store = tmp_path / "a.jsonl", tmp_path / "a.db"
    config = config.model_copy(update={"output": (f"json:{file}", f"store:{store}")})
    out.open(config)
    told = []

    def start(sink):
        # As another thread would, in the middle of a reload.
        told.extend(out.put(event(n)) for n in range(5))
        start_sink(sink)

    monkeypatch.setattr("radard.outputs.fanout.start_sink", start)
    days = config.store.model_copy(update={"keep_days": 7000.0})
    out.reload(config.model_copy(update={"store": days}), [hello()])
    out.close()
    assert told == [True] * 5
    assert [e.id for e in read_events(store)] == [ulid(n) for n in range(5)]
    kinds = [json.loads(line)["type"] for line in file.read_text().splitlines()]
    assert kinds.count("event") == 5


def test_an_output_that_is_named_twice_is_one(tmp_path):
    out, names = outputs(), ("null", f"json:{tmp_path / 'a'}")
    out.open(Config(output=names * 2))
    assert tuple(sink.name for _, sink in out.sinks) == names
    out.close()
