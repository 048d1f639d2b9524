"""The campaigns in their short forms, and that each can find what it looks for."""

import json
import re
import sqlite3
import warnings
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from campaigns import fuzz, soak
from campaigns.fault_run import Watcher, stamp
from campaigns.fuzz_targets import TARGETS
from campaigns.kept import Kept
from campaigns.outputs import Outputs
from campaigns.processes import HARM, end_with
from radard.stream.ring import Dwell
from tests.processes import ran
from tests.radar_helpers import BASEBAND
from x2radar.frame import Frame

ROOT = Path(__file__).parents[2]


def run(name, *argv):
    """The last line of a campaign that finds no harm."""
    done = ran(f"campaigns/{name}.py", *argv, cwd=ROOT, timeout=1200)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert {key: found.pop(key) for key in HARM} == dict.fromkeys(HARM, 0), done.stderr
    return found


@pytest.mark.integration
def test_faults():
    few = ("--runs", "22", "--injected", "2")
    found = run("faults", *few, "--surroundings", "reload_broken,two_daemons")
    assert found["runs"] == 26
    assert found["kinds"]["virtual"]["lost"] > 100


@pytest.mark.integration
def test_kill():
    found = run("kill", "--kills", "3")
    assert found.pop("events") > 0
    assert found == {"kills": 3}


@pytest.mark.integration
def test_soak():
    found = run("soak", "--minutes", "0.2", "--stream-hours", "0.01")
    assert {"rss_growth_kib_per_h", "fd_growth", "thread_growth", "clock_drift_ppm"} < set(found)
    for name in ("hz60", "hz200", "fast"):
        assert found["runs"][name]["exit_code"] == 0
        assert found["runs"][name]["decisions"] > 3


@pytest.mark.integration
def test_clock():
    found = run("clock", "--steps", "3")
    assert found.pop("events") > 0
    # A busy computer loses frames; then fewer decisions can be compared, or none.
    del found["decisions"]
    assert found == {"steps": 3}


@pytest.mark.integration
def test_disk():
    found = run("disk", "--faults", "6")
    assert found["events"] > 0
    assert len(found["faults"]) + len(found["skipped"]) == 6


@pytest.mark.integration
def test_machines():
    found = run("machines", "--steps", "100")
    assert list(found["seconds"]) == ["log", "health", "panel", "ring", "calibration"]


@pytest.mark.integration
def test_fuzz(tmp_path):
    found = run("fuzz", "--inputs", "40", "--keep", str(tmp_path / "found"))
    assert found["inputs"] == 40 * len(TARGETS)
    assert list(found["targets"]) == list(TARGETS)
    assert not (tmp_path / "found").exists()


# ---------------------------------------------------------------- each can find what is wrong


def test_what_a_daemon_must_not_do_to_what_it_kept_is_found(tmp_path):
    """A number used twice, a clip that there is not, an event deleted, another decision."""
    outputs = Outputs(tmp_path, SimpleNamespace(url="mqtt:"))
    kept = Kept(outputs, tmp_path)
    for path in (tmp_path / "log.db", outputs.store):
        with closing(sqlite3.connect(path)) as db:
            db.execute("CREATE TABLE log (n INTEGER, key TEXT, record TEXT)")
            db.execute("CREATE TABLE events (id TEXT)")
            db.execute("INSERT INTO log VALUES (1, 'a', '{}')")
            db.execute("INSERT INTO events VALUES ('one')")
            db.commit()
    kept.look()
    assert not any(kept.found.values())
    for path in (tmp_path / "log.db", outputs.store):
        with closing(sqlite3.connect(path)) as db:
            db.execute("UPDATE log SET key = 'b'")
            db.execute("DELETE FROM events")
            db.commit()
    kept.look()
    told = {"type": "event", "id": "one", "clip": str(tmp_path / "none.h5")}
    lost = {"type": "event", "id": "two", "clip": str(tmp_path / "lost.h5")}
    decided = {"type": "decision", "dropped": 0, "p_human": 0.5}
    rows = [each | phase for each in (told, lost) for phase in ({}, {"phase": "end"})]
    rows += [{"type": "hello"}, decided, {**decided, "dropped": 9}]
    outputs.out.write_text("".join(json.dumps(row) + "\n" for row in rows))
    kept.look_at_clips(f"clip: {lost['clip']}: cannot write")
    assert kept.look_at_decisions([{**decided, "p_human": 0.6}] * 2) == 1
    assert set(kept.found.values()) == {1}


def test_one_module_asks_for_the_clock_on_the_wall():
    """`campaigns/clock.py` sets what that one says."""
    asks = re.compile(r"\btime\.time(_ns)?\b|datetime\.(now|utcnow|today)|\b(local|gm)time\(")
    found = [
        path.relative_to(ROOT).as_posix()
        for folder in ("x2radar", "daemon")
        for path in sorted((ROOT / folder).rglob("*.py"))
        if asks.search(path.read_text())
    ]
    assert found == ["x2radar/wall_clock.py"]


def frame(k, *, late=0, counter=None, lost=0):
    samples = stamp(np.zeros(16, np.float32), (k + late) / 60)
    return Frame(samples, k + 1 if counter is None else counter, k, lost, False, BASEBAND)


FIRST = [frame(k) for k in range(6)]


@pytest.mark.parametrize(
    ("rest", "found"),
    [
        ([frame(k) for k in range(6, 12)], (0, 0, 0)),
        # Stitched: its numbers go on as if nothing had happened, which no driver can count.
        ([frame(k, late=30) for k in range(6, 12)], (1, 0, 1)),
        ([frame(k, late=4, counter=k + 5) for k in range(6, 12)], (1, 4, 0)),
        ([frame(k, lost=4 * (k == 10)) for k in range(10, 13)], (1, 0, 0)),
    ],
    ids=["whole", "stitched", "not counted", "counted but judged"],
)
def test_a_window_that_is_not_whole_is_found(rest, found):
    watcher = Watcher(10, 60.0, SimpleNamespace(now=lambda: 100.0))
    for each in FIRST + rest:
        watcher.frame(each)
    rows = sum(1 + each.lost for each in FIRST + rest)
    samples = np.zeros((10, 64), np.complex64)
    dwell = Dwell(samples, np.ones(10, np.bool_), BASEBAND, 60.0, 1.0, end_frame=rows)
    watcher.decision(dwell, is_whole=True)
    keys = ("gap_decisions", "uncounted", "hidden_restarts")
    assert tuple(watcher.tally[key] for key in keys) == found


def test_harm_is_said_and_fails_a_campaign(capsys):
    assert [end_with({"runs": 3}), end_with({"lost_events": 1})] == [0, 1]
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert all(set(HARM) <= set(line) for line in lines)


@pytest.mark.parametrize(
    ("bad", "wholes", "fault"),
    [
        (None, [(101.0, 1.0)], ""),
        (None, [], "no decision at all"),
        ((100.0, 5.0), [(103.0, 8.0)], ""),
        ((100.0, 5.0), [(103.0, 8.2)], "3.20 s to a decision"),
        ((100.0, 5.0), [(99.0, 4.0)], "no decision after the last fault"),
        ((108.0, 5.0), [(111.0, 7.45)], "8.00 s to good frames"),
    ],
)
def test_silence_and_a_recovery_that_takes_too_long_are_found(bad, wholes, fault):
    clock = SimpleNamespace(s=100.0)
    clock.now = lambda: clock.s
    watcher = Watcher(10, 60.0, clock)
    watcher.last_bad, watcher.wholes = bad, wholes
    assert watcher.recovery(100.0, 7.0).fault == fault
    for is_announced in (True, False, False):
        clock.s += 60
        watcher.look(is_announced=is_announced)
    assert watcher.tally["silent_stalls"] == 1


def test_growth_and_drift_are_found():
    samples = [soak.Sample(2.0 * k, 100_000 + 10 * k, 20 + k // 50, 9) for k in range(200)]
    found = soak.grown(samples, None)
    assert found["rss_growth_kib_per_h"] == pytest.approx(18_000)
    assert (found["fd_growth"], found["thread_growth"]) == (2, 0)
    begun = datetime(2026, 1, 1, tzinfo=UTC)
    rows = [
        {"t_s": float(k), "time": (begun + timedelta(seconds=1.00005 * k)).isoformat()}
        for k in range(1, 1000, 7)
    ]
    assert soak.drift_ppm(rows) == pytest.approx(-50, abs=1)
    assert soak.differing([{"a": 1}] * 9, [{"a": 1}, {"a": 2}, {"a": 1}]) == 5
    assert soak.differing([{"a": 1, "time": "now"}], [{"a": 1, "replayed": True}]) == 0


@pytest.mark.integration
def test_good_inputs_are_read(tmp_path):
    """Fuzzing begins with files that reach far into the readers."""
    for name, target in TARGETS.items():
        folder = tmp_path / name
        (folder / "seeds").mkdir(parents=True)
        (folder / "work").mkdir()
        with warnings.catch_warnings():
            target.run(folder / "work", target.seeds(folder / "seeds")[0])


@pytest.mark.integration
def test_what_goes_wrong_is_counted_and_kept(tmp_path, monkeypatch):
    """Inputs that raise, hang, grow and kill their process, by a target that does all that."""
    (tmp_path / "bad_targets.py").write_text(
        "from campaigns.fuzz_targets import Target\n"
        "def run(folder, data): exec(data)\n"
        "TARGETS = {'bad': Target(run, lambda folder: [b'pass'])}\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    worker = fuzz.Worker(("bad",), tmp_path, module="bad_targets")
    campaign = fuzz.Campaign(tmp_path / "found", worker)
    inputs = [
        b"pass",
        b"from x2radar.errors import SceneError; raise SceneError('as it should be')",
        b"raise KeyError(1)",
        b"while True: pass",
        b"import os; os.abort()",
        b"x = bytearray(600 << 20)",
        b"pass",
    ]
    try:
        campaign.feed("bad", iter(inputs))
    finally:
        worker.close()
    assert campaign.summary()["targets"]["bad"] == {
        "inputs": 7,
        "unhandled": 2,
        "hangs": 1,
        "over_memory": 1,
    }
    assert sorted(path.read_bytes() for path in (tmp_path / "found").iterdir()) == sorted(
        inputs[2:6]
    )
