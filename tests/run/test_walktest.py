import json
import signal
from dataclasses import replace
from importlib import resources

import pytest

from radard.cli import main
from radard.commands import walktest
from radard.commands.walktest import RangeCell, WalkDecision, by_range, report, verdict
from radard.config.config import load_config
from tests.device_helpers import plugged
from tests.processes import environ, started
from tests.waiting import unmeasured
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene


def step(t_s, range_m=None, *, alarm=False):
    over_db = 0.5 if range_m is None else 9.0
    label = "none" if range_m is None else "human"
    return WalkDecision(
        t_s=t_s, range_m=range_m, over_floor_db=over_db, label=label, p_human=None, alarm=alarm
    )


def test_a_walk_that_is_always_seen():
    cells = by_range([step(float(k), 0.75 + 0.25 * k, alarm=k > 2) for k in range(8)])
    assert [c.near_m for c in cells] == [0.5, 1.0, 1.5, 2.0, 2.5]
    assert [c.far_m for c in cells] == [1.0, 1.5, 2.0, 2.5, 3.0]
    assert [c.windows for c in cells] == [c.seen for c in cells] == [1, 2, 2, 2, 1]
    assert [c.alarms for c in cells] == [0, 0, 2, 2, 1]
    assert all(c.missed == 0 and c.visits == 1 for c in cells)
    # Where the walk begins, nobody knows when the walker came in.
    assert [c.first_seen_s for c in cells] == [None, 0.0, 0.0, 0.0, 0.0]


def test_what_lies_between_two_sightings_was_missed():
    # From 1.2 m at 0 s to 3.2 m at 8 s: unseen at 1.45, 1.7, ... 2.95 m.
    walk = [step(0.0, 1.2), *(step(float(k)) for k in range(1, 8)), step(8.0, 3.2)]
    cells = {c.near_m: c for c in by_range(walk)}
    found = [(c.windows, c.seen, c.missed) for c in cells.values()]
    assert found == [(2, 1, 0), (2, 0, 1), (2, 0, 1), (2, 0, 1), (1, 1, 0)]
    assert cells[3.0].first_seen_s == pytest.approx(0.8)


def test_who_walks_fast_leaves_no_stretch_out():
    """As on the page: a decision is of all the way since the last one."""
    cells = by_range([step(float(k), m, alarm=True) for k, m in enumerate((0.7, 2.2, 3.2, 1.2))])
    assert [c.near_m for c in cells] == [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]
    assert all(c.is_good for c in cells)
    assert verdict(cells).startswith("passed")
    # What was not seen on the way was missed there.
    cells = by_range([step(0.0, 0.7, alarm=True), step(0.5), step(1.0, 2.2, alarm=True)])
    assert [c.near_m for c in cells] == [0.5, 1.0, 2.0]


def test_a_window_that_cannot_be_judged_is_not_held_against_the_mount():
    walk = [step(float(k), 0.75 + 0.25 * k, alarm=True) for k in range(8)]
    torn = replace(step(3.5), over_floor_db=None)
    assert by_range([*walk[:4], torn, *walk[4:]]) == by_range(walk)


@pytest.mark.parametrize(("gap_s", "n_cells"), [(10.0, 5), (10.1, 2)])
def test_longer_gaps_are_nobodys(gap_s, n_cells):
    walk = [step(0.0, 1.2), *(step(gap_s * k / 8) for k in range(1, 8)), step(gap_s, 3.2)]
    assert len(by_range(walk)) == n_cells


def test_coming_in_unseen_takes_time():
    # In at 2 m at 2 s, seen at 5 s.
    walk = [step(0.0, 1.5), step(1.0), step(2.0), step(3.0), step(4.0), step(5.0, 2.75)]
    assert by_range(walk)[1] == RangeCell(
        near_m=2.0, far_m=2.5, windows=2, seen=0, alarms=0, visits=1, missed=1, first_seen_s=None
    )
    walk[-1] = step(5.0, 2.45)
    assert by_range(walk)[1].first_seen_s == pytest.approx(5 - 5 * 0.5 / 0.95, abs=0.01)


def test_before_the_first_and_after_the_last_sighting_nothing_counts():
    assert list(report([step(1.0)], by_range([step(1.0)]))) == ["nothing was seen in 1 windows"]
    walk = [step(0.0), step(1.0), step(2.0, 1.2), step(3.0), step(4.0)]
    (cell,) = by_range(walk)
    assert (cell.windows, cell.seen) == (1, 1)
    assert next(iter(report(walk, [cell]))).startswith("first seen 2.0 s after the first window")


def test_command_logs_and_reports(capsys):
    argv = ["walktest", "--port", "sim:human?seed=1", "--speed", "max", "--duration", "12"]
    assert main(argv) == 0
    log, _, told = capsys.readouterr().out.partition("\n\n")
    assert len(log.splitlines()) == 10
    assert "first seen" in told
    assert main([*argv, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert len(again["log"]) == 10
    assert {"near_m", "seen", "first_seen_s"} <= set(again["cells"][0])
    seen = sum(cell["seen"] for cell in again["cells"])
    assert seen == sum(step["range_m"] is not None for step in again["log"])


@pytest.mark.integration
def test_interrupt_ends_the_walk_with_its_report():
    argv = ("walktest", "--port", "sim:human?seed=1", "--speed", "8", "--model", "none")
    env = {**unmeasured(), "PYTHONPATH": environ()["PYTHONPATH"]}
    with started("-m", "tests.busy_machine", *argv, text=True, stderr=None, env=env) as running:
        try:
            first = [running.stdout.readline() for _ in range(4)]
            running.send_signal(signal.SIGINT)
            rest = running.communicate(timeout=60)[0]
        finally:
            running.kill()
    assert running.returncode == 0
    assert all(" dB " in line for line in first)
    assert "range           seen" in rest or "nothing was seen" in rest


def test_a_walk_measures_the_level_and_a_glance_does_not(capsys):
    argv = ["walktest", "--port", "sim:human?seed=2", "--speed", "max", "--model", "none"]
    for seconds, is_measured in ((15, True), (4, False)):
        run = [*argv, "--duration", str(seconds)]
        assert main([*run, "--json"]) == 0
        level_db = json.loads(capsys.readouterr().out)["level_db"]
        assert (level_db is not None and 35 < level_db < 60) is is_measured
        assert main(run) == 0
        said = f"mount.level_db: {level_db or 0:.1f} in the configuration"
        assert (said in capsys.readouterr().out) is is_measured


GOOD = RangeCell(
    near_m=0, far_m=0, windows=10, seen=10, alarms=10, visits=2, missed=0, first_seen_s=0.0
)


def walked(n_seen, n_alarms, cells=(2, 3, 4, 5)):
    """Cells of a walk from 1 m to 3 m, of which each but the one in the middle is good."""
    walk = [replace(GOOD, near_m=k / 2, far_m=(k + 1) / 2) for k in cells]
    return [replace(c, seen=n_seen, alarms=n_alarms) if c.near_m == 2 else c for c in walk]


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        (walked(9, 5), "passed: seen and taken for a person from 1 to 3 m"),
        (walked(8, 8), "not passed: not good enough at 2 to 2.5 m"),
        (walked(10, 4), "not passed: not good enough at 2 to 2.5 m"),
        (walked(0, 0, (2, 3, 5)), "not passed: nobody walked at 2 to 2.5 m"),
        (walked(9, 9, (2, 3)), "not passed: walk at least 1.5 m of the range"),
    ],
)
def test_one_rule_says_whether_a_walk_is_good_enough(cells, words):
    assert verdict(cells) == words


def test_the_page_has_the_same_rule():
    page = resources.files("radard.web").joinpath("static/pages/walk.js").read_text()
    for name in ("CELL_M", "MIN_SEEN", "MIN_HUMAN", "MIN_CELLS"):
        assert f"const {name} = {getattr(walktest, name):g};" in page


@pytest.mark.integration
def test_an_adults_level_is_kept_where_the_daemon_finds_it(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("RADARD_SERVICE__STATE_DIR", str(tmp_path))
    with plugged(SimulatedModule(load_scene("human")), speed=20.0) as far:
        argv = ["walktest", "--adult", "--model", "none", "--port", far.path]
        assert main([*argv, "--duration", "15", "--json"]) == 0
        told = capsys.readouterr()
        level_db = json.loads(told.out)["level_db"]
        kept = tmp_path / "radar.settings.yaml"
        assert f"{level_db:.1f}, an adult's level, is kept in {kept}" in told.err
        environment = {"RADARD_SERVICE__STATE_DIR": str(tmp_path)}
        assert load_config(environ=environment).mount.level_db == pytest.approx(level_db)
        assert main([*argv, "--duration", "3"]) == 1
        assert "which tells no level" in capsys.readouterr().err
    assert main(["walktest", "--adult", "--port", "sim:human"]) == 2
    assert "only a real radar's level" in capsys.readouterr().err
