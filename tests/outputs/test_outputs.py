"""From the configuration to the sinks: names, reloads, and what is killed in between."""

import json
import socket
import sqlite3
import subprocess
import time
from contextlib import closing

import pytest

from radard.alarm.sensor_state import KeptState
from radard.config.config import load_config
from radard.log_file import read_events
from radard.outputs.fanout import Outputs
from radard.outputs.registry import start_sink
from tests.processes import started
from tests.radar_helpers import records_in
from tests.run.test_tamper_commands import Room
from tests.sink_helpers import FakeHost, event, hello, ulid
from tests.waiting import free_port, wait_for
from tests.web_helpers import ask

pytestmark = pytest.mark.integration


def config_of(folder, *names, port="/dev/nothing", **sections):
    """The configuration of a daemon with this state directory."""
    options = {"sensor": {"name": "hall", "port": port}, "service": {"state_dir": folder}}
    options |= {"log": {"first_retry_s": 0.02, "longest_retry_s": 0.05}, "output": list(names)}
    return load_config(environ={}, options=options | sections)


def outputs():
    out = Outputs(stdout_is_terminal=False)
    out.add(FakeHost("hall"))
    return out


def outputs_of(folder, *names, **options):
    """Outputs as of a daemon with this state directory."""
    out = outputs()
    out.open(config_of(folder, *names, **options))
    return out


@pytest.fixture
def out(monkeypatch):
    """Outputs that are opened again at once, if they could not be."""
    monkeypatch.setattr("radard.outputs.fanout._RETRY_S", 0.0)
    made = outputs()
    yield made
    made.close()


@pytest.fixture
def configured(tmp_path, server):
    """Return the configuration of a webhook and more."""
    url = f"webhook:http://127.0.0.1:{server.port}/"
    return lambda *names, **webhook: config_of(tmp_path, url, *names, webhook=webhook)


def types_in(path):
    return [line["type"] for line in records_in(path)]


def ids_in(path):
    return [row["id"] for row in records_in(path) if row["type"] == "event"]


def test_changed_options_hold_after_a_reload_and_no_event_is_lost(out, configured, server):
    server.code = 500
    out.open(configured())
    out.put(event(1, kind="fault"))
    wait_for(lambda: server.posts)
    out.reload(configured(kinds=["alarm"]), [hello()])
    out.put(event(2, kind="fault"))
    out.put(event(3))
    server.code = 200
    wait_for(lambda: ulid(3) in server.ids())
    out.close()
    assert set(server.ids()) == {ulid(1), ulid(3)}


@pytest.mark.parametrize("is_webhook", [True, False])
def test_a_secret_that_was_renewed_holds_after_a_reload(out, server, tmp_path, is_webhook):
    """Before, one that was read at the start, as a page's token, held until a restart."""
    secret, base = tmp_path / "secret", f"http://127.0.0.1:{free_port()}"
    url = f"http://127.0.0.1:{server.port}"
    sections = {} if is_webhook else {"web": {"token_file": secret}}
    config = config_of(tmp_path, f"webhook:@{secret}" if is_webhook else base, **sections)
    secret.write_text(f"{url}/old" if is_webhook else "old token of it")
    out.open(config)
    secret.write_text(f"{url}/renewed" if is_webhook else "a renewed one")
    out.reload(config, [hello()])
    if is_webhook:
        out.put(event(1))
        wait_for(lambda: server.posts)
        assert server.posts[0][0] == "/renewed"
        return
    old, renewed = ({"Authorization": f"Bearer {t}"} for t in ("old token of it", "a renewed one"))
    wait_for(lambda: ask(f"{base}/api/v1/config", headers=renewed)[0] == 200)
    assert ask(f"{base}/api/v1/config", headers=old)[0] == 401


def test_many_that_hang_hold_up_a_reload_as_long_as_one(out, tmp_path):
    """Before, each took two seconds, and with the main thread away the watchdog is not fed."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        urls = [f"webhook:http://127.0.0.1:{silent.getsockname()[1]}/{k}" for k in range(8)]
        out.open(config_of(tmp_path, *urls))
        out.put(event(1))
        wait_for(lambda: all(sink.state.busy_s > 0 for _, sink in out.sinks))
        began_s = time.monotonic()
        out.reload(config_of(tmp_path, *urls, webhook={"phases": ["new"]}), [hello()])
        assert time.monotonic() - began_s < 8.0


def test_how_many_events_are_kept_holds_after_a_reload(out, tmp_path):
    out.open(config_of(tmp_path, "null"))
    out.reload(config_of(tmp_path, "null", log={"max_events": 100}), [hello()])
    for k in range(150):
        out.log.append(event(k))
    assert len(out.log.events()) == 100


def test_a_sink_goes_on_until_another_can_take_over(out, configured, server, tmp_path, caplog):
    secret = tmp_path / "secret"
    out.open(configured())
    for _ in range(2):
        out.reload(configured(secret_file=str(secret), phases=["new"]), [hello()])
        out.retry()
    (((_, name), why),) = out.faults.items()
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
    assert server.ids() == [ulid(1), ulid(3)]
    assert "webhook-signature" in server.posts[-1][1]


def test_undoing_a_change_that_could_not_be_opened_is_no_fault(out, configured):
    good = configured()
    out.open(good)
    before = out.sinks
    out.reload(configured(ca_file="/nowhere/x"), [hello()])
    assert out.faults
    out.reload(good, [hello()])
    assert (out.faults, out.sinks) == ({}, before)


def test_records_wait_for_an_added_output_that_cannot_be_opened_yet(out, configured, tmp_path):
    file = tmp_path / "later" / "x.jsonl"
    out.open(configured())
    out.reload(config_of(tmp_path, f"json:{file}"), [hello()])
    out.put(event(1))
    file.parent.mkdir()
    out.retry()
    out.close()
    assert types_in(file) == ["hello", "event"]


def test_what_only_memory_holds_outlives_a_reload(out, configured, server, tmp_path):
    (tmp_path / "log.db").mkdir()
    server.code = 500
    out.open(configured())
    out.put(event(1))
    wait_for(lambda: server.posts)
    out.reload(configured(timeout_s=9.0), [hello()])
    server.code = 200
    wait_for(lambda: out.sinks[0][1].state.n_sent == 1)
    assert set(server.ids()) == {ulid(1)}


def test_only_what_changed_is_reopened(out, configured, tmp_path):
    file, store = tmp_path / "a.jsonl", tmp_path / "a.db"
    config = configured(f"json:{file}", f"store:{store}")
    out.open(config)
    before = [sink for _, sink in out.sinks]
    out.put(hello())
    section = config.store.model_copy(update={"decisions": False})
    out.reload(config.model_copy(update={"store": section}), [hello(sensitivity="low")])
    after = [sink for _, sink in out.sinks]
    assert [a is b for a, b in zip(before, after, strict=True)] == [True, True, False]
    out.put(event(1))
    out.close()
    assert types_in(file) == ["hello", "hello", "event"]
    assert [e.id for e in read_events(store)] == [ulid(1)]


def test_what_comes_while_an_output_is_reopened_waits_for_it(out, tmp_path, monkeypatch):
    file, store = tmp_path / "a.jsonl", tmp_path / "a.db"
    config = config_of(tmp_path, f"json:{file}", f"store:{store}")
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
    assert types_in(file).count("event") == 5


def test_an_output_that_is_named_twice_is_one(out, tmp_path):
    names = ("null", f"json:{tmp_path / 'a'}")
    out.open(config_of(tmp_path, *names, *names))
    assert tuple(sink.name for _, sink in out.sinks) == names


TOLD = """
import json, sys
from pathlib import Path
from tests.outputs.test_outputs import outputs_of
folder, *names = json.loads(sys.argv[1])
out = outputs_of(Path(folder), *names)
for line in sys.stdin:
    out.put(json.loads(line))
"""


def n_done(folder):
    """How many outputs have all events, as the file of the log knows."""
    with closing(sqlite3.connect(folder / "log.db", timeout=60)) as db:
        return db.execute("SELECT count(*) FROM cursors WHERE done = seen").fetchone()[0]


def test_a_kill_behind_the_first_outputs_word_costs_the_others_nothing(tmp_path, server):
    store, lines = tmp_path / "events.db", tmp_path / "out.jsonl"
    outputs_of(tmp_path, f"store:{store}").close()
    names = (f"json:{lines}", f"store:{store}", f"webhook:http://127.0.0.1:{server.port}/")
    pipes = {"stdin": subprocess.PIPE, "stdout": None, "stderr": None}
    process = started("-c", TOLD, json.dumps([str(tmp_path), *names]), text=True, **pipes)

    def put(record):
        process.stdin.write(json.dumps(record) + "\n")
        process.stdin.flush()

    put(hello())
    wait_for(lambda: lines.exists() and "hello" in lines.read_text())
    server.code = 500
    # Somebody holds the store, and the server takes nothing.
    with closing(sqlite3.connect(store)) as db:
        db.execute("BEGIN EXCLUSIVE")
        put(event(1))
        wait_for(lambda: ids_in(lines) == [ulid(1)])
        # A kill before the log knows that the file has it would let it be told there twice.
        wait_for(lambda: n_done(tmp_path) == 1)
        process.kill()
        process.communicate()
    assert read_events(store) == []
    server.code = 200
    n_before = len(server.posts)
    again = outputs_of(tmp_path, *names)
    again.put(hello())
    wait_for(lambda: len(server.posts) > n_before and read_events(store))
    wait_for(lambda: n_done(tmp_path) == 3)
    again.close()
    assert [row.id for row in read_events(store)] == [ulid(1)]
    assert server.ids()[-1] == ulid(1)
    # Who has spoken before is not told again, now and in the run after it.
    outputs_of(tmp_path, *names).close()
    assert ids_in(lines) == [ulid(1)]


def test_a_replay_leaves_nothing_for_the_next_run(out, tmp_path):
    out.open(config_of(tmp_path, f"json:{tmp_path / 'out.jsonl'}", port="replay:x.h5"))
    out.put(hello())
    out.put(event(3))
    out.close()
    assert ids_in(tmp_path / "out.jsonl") == [ulid(3)]
    assert not (tmp_path / "log.db").exists()


def test_a_new_alarm_is_kept_before_it_is_told_and_an_end_is_told_before_that_is_kept():
    room, order = Room(), []
    room.worker._store.save = lambda state: order.append(("kept", state.alarm_id))
    room.worker._put = lambda record, **_: order.append((record["type"], record.get("phase")))
    kept = KeptState(is_armed=True, entry_reason="human at 2.0 m")
    room.worker._emit(room.worker.tracker.resume(kept))
    (_, alarm_id), told = order
    assert alarm_id is not None
    assert told == ("event", "new")
    order.clear()
    room.command("disarm")
    assert order == [("event", "end"), ("kept", None)]
