"""What is named is on the bill, and the echo's error is bounded."""

import numpy as np
import pytest

from benchmarks import bench_scene
from tests.sim.test_sim_scene import FULL
from x2radar.cli import main
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module import cost, stream
from x2radar.sim.scene.scene import ERRORS_DB, load_scene, parse_scene
from x2radar.sim.things import THINGS

IQ = RadarSettings(output="iq")
NOTHING = "steps: [{duration_s: 9}]\n"


def test_the_bill_has_what_the_scene_names_and_nothing_else():
    names = [name for name, _ in cost.parts(parse_scene(FULL, "full", "full"))]
    assert names == [
        *("body: thesis_human", "thing: fan", "body: thesis_dog", "thing: curtain"),
        *("antenna's pattern", "multipath: surfaces", "room", "multipath: tail", "mount"),
        *("receiver: jitter_s", "receiver: gain_noise", "receiver: lost_share"),
    ]
    assert {name.removeprefix("thing: ") for name in names if "thing" in name} <= set(THINGS)
    assert not list(cost.parts(parse_scene(NOTHING, "t", "t")))


@pytest.mark.parametrize("bound_db", ERRORS_DB)
def test_a_scene_bounds_its_echoes_error(monkeypatch, bound_db):
    asked, made = [], stream.echo_frames

    def noted(*args, error_db, **how):
        asked.append(error_db)
        return made(*args, error_db=error_db, **how)

    monkeypatch.setattr(stream, "echo_frames", noted)
    text = f"steps: [{{body: thesis_cat, duration_s: 9}}]\nerror_db: {bound_db:g}"
    stream.EchoStream(parse_scene(text, "t", "t"), 0, IQ).next()
    assert asked == [bound_db]


@pytest.mark.parametrize("output", ["rf", "iq"])
def test_the_error_measured_is_within_each_bound(output):
    lines = list(cost.echoes(load_scene("human"), 0, RadarSettings(output=output)))
    assert [line.part for line in lines] == [f"echoes within {db:g} dB" for db in ERRORS_DB]
    for bound_db, line in zip(ERRORS_DB, lines, strict=True):
        assert bound_db - 45 < line.error_db <= bound_db + 0.5
        assert line.cpu_ms > 0


def test_a_bill_adds_up_and_the_command_prints_it(capsys):
    lines = {line.part: line for line in cost.bill(load_scene("thesis_cat"))}
    whole = lines["the whole scene"]
    assert list(lines)[:2] == ["noise of the receiver", "body: thesis_cat"]
    assert lines["the whole scene at 200 Hz"].cpu_ms > whole.cpu_ms
    assert np.isfinite([line.cpu_ms for line in lines.values()]).all()
    assert main(["simulate", "--cost", "--scene", "empty"]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert "CPU for a second of the stream" in head
    assert rows[0].startswith("noise of the receiver")
    assert all(" ms" in row for row in rows)


def test_bench_scene_measures_a_part(tmp_path):
    person = next(bench_scene.rows(tmp_path))
    assert bench_scene.measured([person], 3)[person.part] > 0
