"""What is not named costs nothing, what is named is on the bill, the echo's error is bounded."""

import numpy as np
import pytest

from benchmarks import bench_scene
from tests.sim.test_sim_scene import FULL
from x2radar.cli import main
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module import cost, stream
from x2radar.sim.place.antenna import Antenna
from x2radar.sim.scene import stage
from x2radar.sim.scene.scene import ERRORS_DB, load_scene, parse_scene
from x2radar.sim.signal import receiver
from x2radar.sim.signal.effects import FrameDraws
from x2radar.sim.things import THINGS

IQ = RadarSettings(output="iq")
NOTHING = "steps: [{duration_s: 9}]\n"
NAMED = {
    "room: {objects_db: 50}": (stream, "Room"),
    "clutter: [{range_m: 1, rcs_m2: 9}]": (stream.LinkBudget, "amplitude"),
    "surfaces: [{axis: z}]": (stage, "image_rows"),
    "tail: {n_paths: 16}": (stage, "DiffuseTail"),
    "mount: {}": (stage, "draw_mount"),
    "antenna: {}": (Antenna, "gain"),
    "receiver: {jitter_s: 1.0e-13}": (receiver, "delayed_baseband"),
    "receiver: {gain_noise: 1.0e-3}": (FrameDraws, "gain"),
}
"""What a scene names, and what then is called for it."""


def counting(of, part, found):
    def counted(*args, **how):
        found[part] += 1
        return of(*args, **how)

    return counted


def calls(monkeypatch, text):
    """How often what each part needs is called while a scene with somebody in it is played."""
    found = dict.fromkeys(NAMED, 0)
    with monkeypatch.context() as patch:
        for part, (place, name) in NAMED.items():
            patch.setattr(place, name, counting(getattr(place, name), part, found))
        frames = stream.EchoStream(parse_scene(text, "t", "t"), 0, IQ)
        for _ in range(20):
            frames.next()
    return found


@pytest.mark.parametrize("part", NAMED)
def test_what_is_not_named_is_not_called(monkeypatch, part):
    body = "steps: [{body: thesis_human, duration_s: 9}]\n"
    alone, plain = calls(monkeypatch, body + part), calls(monkeypatch, body)
    named = {name for name, n in alone.items() if n > plain[name]}
    # Ways by surfaces and things leave in directions of their own.
    assert part in named <= {part, "antenna: {}"}
    # Of a body alone there is its echo, and of an empty room its noise.
    assert [name for name, n in plain.items() if n] == ["clutter: [{range_m: 1, rcs_m2: 9}]"]
    assert not any(calls(monkeypatch, NOTHING).values())


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


def test_a_bill_adds_up():
    lines = {line.part: line for line in cost.bill(load_scene("thesis_cat"))}
    whole = lines["the whole scene"]
    assert list(lines)[:2] == ["noise of the receiver", "body: thesis_cat"]
    assert lines["the whole scene at 200 Hz"].cpu_ms > whole.cpu_ms
    assert np.isfinite([line.cpu_ms for line in lines.values()]).all()


def test_the_command_prints_the_bill(capsys):
    assert main(["simulate", "--cost", "--scene", "empty"]) == 0
    head, *rows = capsys.readouterr().out.splitlines()
    assert "CPU for a second of the stream" in head
    assert rows[0].startswith("noise of the receiver")
    assert all(" ms" in row for row in rows)


def test_bench_scene_measures_a_part(tmp_path):
    person = next(bench_scene.rows(tmp_path))
    assert bench_scene.measured([person], 3)[person.part] > 0
