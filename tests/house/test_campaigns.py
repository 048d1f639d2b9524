"""The campaigns in their short forms, and that each can find what it looks for."""

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from campaigns import fault_run, faults, load, soak, surroundings
from campaigns.fault_run import Recovery, Watcher, read_stamp, stamp
from radard.stream.ring import Dwell
from tests.radar_helpers import BASEBAND
from x2radar.frame import Frame

ROOT = Path(__file__).parents[2]


def run(name, *argv):
    """A campaign's exit code and last line."""
    done = subprocess.run(
        [sys.executable, f"campaigns/{name}.py", *argv],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=1200,
    )
    assert done.stdout, done.stderr
    return done.returncode, json.loads(done.stdout.splitlines()[-1]), done.stderr


def test_faults():
    few = ("--runs", "22", "--pty", "1", "--injected", "2")
    code, found, said = run("faults", *few, "--surroundings", "reload_broken,two_daemons")
    assert code == 0, said
    harm = ("crashes", "deadlocks", "gap_decisions", "silent_stalls", "unrecovered", "uncounted")
    assert {key: found[key] for key in harm} == dict.fromkeys(harm, 0), said
    assert found["runs"] == 27
    assert found["lost_events"] == 0
    assert found["kinds"]["virtual"]["lost"] > 100


def test_the_same_seed_finds_the_same():
    one, two = (faults.judged(faults.virtual_run(1, 5))[0] for _ in range(2))
    assert one == two
    assert one["frames"] > 0


def test_kill():
    code, found, said = run("kill", "--kills", "3")
    assert code == 0, said
    assert found.pop("events") > 0
    assert found == {
        "kills": 3,
        **dict.fromkeys(("lost_events", "duplicate_events", "unreadable", "lost_states"), 0),
    }


def test_soak():
    code, found, said = run("soak", "--minutes", "0.2", "--stream-hours", "0.01")
    assert code == 0, said
    assert found["decisions_differ"] == 0
    assert {"rss_growth_kib_per_h", "fd_growth", "thread_growth", "clock_drift_ppm"} < set(found)
    for name in ("hz60", "hz200", "fast"):
        assert found["runs"][name]["exit_code"] == 0
        assert found["runs"][name]["decisions"] > 3


def test_load():
    code, found, said = run("load", "--radars", "2,4", "--seconds", "3", "--pages", "2")
    assert code == 0, said
    assert found["radars"] == [2, 4]
    assert found["dropped"] == 0
    for row in found["runs"]:
        assert row["exit_code"] == 0
        assert row["slowest_share"] > 0
        assert row["page_messages_min"] > 0


# ---------------------------------------------------------------- each can find what is wrong


class Clock:
    """Time that a test sets."""

    def __init__(self):
        self.s = 100.0

    def now(self):
        return self.s


def frame(k, *, made_s=None, lost=0, restarted=False, counter=None):
    samples = stamp(np.zeros(16, np.float32), k / 60 if made_s is None else made_s)
    return Frame(samples, k + 1 if counter is None else counter, k, lost, restarted, BASEBAND)


def judged_whole(frames, *, n=10):
    """What a watcher notes when the last `n` rows are judged as whole."""
    watcher = Watcher(n, 60.0, Clock())
    rows = 0
    for each in frames:
        rows += 1 + (0 if each.restarted else each.lost)
        watcher.frame(each)
    rows_of = np.zeros((n, 64), np.complex64)
    dwell = Dwell(rows_of, np.ones(n, np.bool_), BASEBAND, 60.0, 1.0, end_frame=rows)
    watcher.decision(dwell, is_whole=True)
    return watcher.tally


def test_a_stamp_survives_and_a_damaged_one_is_known():
    samples = stamp(np.zeros(16, np.float32), 12.3456)
    assert read_stamp(samples) == 12.346
    samples[1] += 1
    assert read_stamp(samples) is None
    samples[:3] = np.nan
    assert read_stamp(samples) is None


def test_a_whole_window_is_no_gap_decision():
    tally = judged_whole([frame(k) for k in range(12)])
    assert (tally.gap_decisions, tally.uncounted) == (0, 0)


def test_a_stitched_window_is_found():
    late = [frame(k, made_s=(k + 30) / 60, counter=k + 1) for k in range(6, 12)]
    tally = judged_whole([*(frame(k) for k in range(6)), *late])
    # Its numbers go on as if nothing had happened: no driver can count that.
    assert (tally.gap_decisions, tally.uncounted, tally.hidden_restarts) == (1, 0, 1)


def test_frames_that_nobody_counted_are_found():
    late = [frame(k, made_s=(k + 4) / 60, counter=k + 5) for k in range(6, 12)]
    tally = judged_whole([*(frame(k) for k in range(6)), *late])
    assert (tally.gap_decisions, tally.uncounted) == (1, 4)


def test_a_gap_that_is_counted_but_judged_is_found():
    rest = [frame(k, lost=4 * (k == 10)) for k in range(10, 13)]
    tally = judged_whole([*(frame(k) for k in range(6)), *rest])
    assert (tally.gap_decisions, tally.uncounted) == (1, 0)


def test_silence_is_found_once():
    clock = Clock()
    watcher = Watcher(10, 60.0, clock)
    for is_announced in (True, False, False):
        clock.s += 60
        watcher.look(is_announced=is_announced)
    assert watcher.tally.silent_stalls == 1


@pytest.mark.parametrize(
    ("bad", "wholes", "limit_s", "fault"),
    [
        (None, [(101.0, 1.0)], 7.0, ""),
        (None, [], 7.0, "no decision at all"),
        ((100.0, 5.0), [(103.0, 8.0)], 7.0, ""),
        ((100.0, 5.0), [(103.0, 8.2)], 7.0, "3.20 s to a decision"),
        ((100.0, 5.0), [(99.0, 4.0)], 7.0, "no decision after the last fault"),
        ((108.0, 5.0), [(111.0, 7.45)], 7.0, "8.00 s to good frames"),
    ],
)
def test_a_recovery_that_takes_too_long_is_found(bad, wholes, limit_s, fault):
    watcher = Watcher(10, 60.0, Clock())
    watcher.last_bad, watcher.wholes = bad, wholes
    assert watcher.recovery(100.0, limit_s).fault == fault


def test_what_frames_and_statistics_say_must_agree():
    tally = fault_run.Tally(lost=3)
    found = {"tally": tally, "recovery": Recovery(0.0, 0.0, ""), "stats": SimpleNamespace(lost=5)}
    counts, _ = faults.judged({**found, "crash": "Traceback"})
    assert (counts["uncounted"], counts["crashes"]) == (2, 1)


def test_growth_and_drift_are_found():
    soaked = object.__new__(soak.Soaked)
    soaked.samples = [soak.Sample(2.0 * k, 100_000 + 10 * k, 20 + k // 50, 9) for k in range(200)]
    soaked.n_messages, soaked.code = 0, 0
    found = soaked.found(None)
    assert found["rss_growth_kib_per_h"] == pytest.approx(18_000)
    assert (found["fd_growth"], found["thread_growth"]) == (2, 0)
    lines = [
        json.dumps(
            {
                "type": "decision",
                "t_s": float(k),
                "time": f"2026-01-01T00:{k // 60:02}:{k % 60 + 0.000050 * k:09.6f}+00:00",
            }
        )
        for k in range(1, 1000, 7)
        if k % 60 + 0.00005 * k < 60
    ]
    assert soak.drift_ppm(lines) == pytest.approx(-50, abs=1)
    assert soak.differing([{"a": 1}] * 5, [{"a": 1}] * 3 + [{"a": 2}] + [{"a": 1}]) == 1
    assert soak.differing([{"a": 1}] * 9, [{"a": 1}] * 3) == 4


def test_cases_are_named_and_sensors_differ():
    assert set(surroundings.CASES) == {
        *("broker_down", "broker_slow", "broker_flapping", "store_locked", "disk_full"),
        *("read_only_state", "clock_stepped", "stopped", "starved", "model_replaced"),
        *("reload_broken", "two_daemons"),
    }
    assert len(load.sensors_of(100)) == 100
    assert not set(load.sensors_of(5)) & set(load.sensors_of(5, first=5))
