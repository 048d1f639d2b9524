"""What a scene may say, and what is named is on its bill of computing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks import bench_scene
from x2radar.cli import main
from x2radar.errors import SceneError
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module import cost, stream
from x2radar.sim.scene.cast import BODIES
from x2radar.sim.scene.scene import ERRORS_DB, builtin_scenes, load_scene, parse_scene, scene_names
from x2radar.sim.things.kinds import THINGS

STEP = "steps: [{body: thesis_cat, duration_s: 5}]\n"


def test_builtin_scenes_play_every_body_and_thing():
    scenes, named = builtin_scenes(), set()
    assert tuple(scene.name for scene in scenes) == scene_names()
    assert {"cat", "demo", "dog", "empty", "human", "thesis_human"} <= set(scene_names())
    for scene in scenes:
        assert load_scene(scene.name) == scene
        assert scene.description
        assert scene.description == " ".join(scene.description.split())
        assert scene.steps
        named |= {actor.kind for actor in scene.background}
        for step in scene.steps:
            for one in step:
                named |= {actor.kind for actor in one.actors}
    # Recorded motion needs a file.
    assert named == {*BODIES, *THINGS} - {"motion"}


def test_a_file_says_the_same_as_a_builtin_scene(tmp_path):
    path = tmp_path / "room.yml"
    path.write_text(
        "description: >\n  A room,\n  in two lines.\n"
        "steps:\n  - {body: thesis_dog, duration_s: 2}\n  - {body: null, duration_s: 1.5}\n"
        "clutter:\n  - {range_m: 1, rcs_m2: 2.5e+3}\n"
    )
    scene = load_scene(str(path))
    assert scene.name == "room"
    assert scene.description == "A room, in two lines."
    (dog,), (nobody,) = scene.steps
    assert [(a.kind, dict(a.options)) for a in dog.actors] == [("thesis_dog", {})]
    assert (nobody.actors, nobody.least_s, nobody.most_s) == ((), 1.5, 1.5)
    assert scene.clutter == ((1.0, 2500.0),)


FULL = """
description: Everything at once.
antenna: {height_m: 1.2, tilt_deg: 10}
room: {objects_db: 50, diffuse_db: 35, leakage_db: 60, drift_m: 1.0e-5}
surfaces: [{axis: z, at_m: 0}, {axis: y, at_m: 4, permittivity: 5}]
tail: {}
mount: {hum_hz: 12}
receiver: {jitter_s: 2.0e-13, gain_noise: 1.0e-3, lost_share: 0.01}
background: [{thing: curtain, position_m: [1, 2.5], probability: 0.5}]
steps:
  - duration_s: [2, 4]
    actors: [{body: thesis_human}, {thing: fan, position_m: [0, 2], probability: 0.3}]
  - one_of:
      - {weight: 2, body: thesis_dog, duration_s: 3}
      - {duration_s: 1}
"""


def test_everything_that_a_scene_may_name(tmp_path):
    path = tmp_path / "full.yaml"
    path.write_text(FULL)
    scene = load_scene(str(path))
    assert (scene.antenna.tilt_deg, scene.room.leakage_db, len(scene.surfaces)) == (10, 60, 2)
    assert scene.tail is not None
    assert dict(scene.mount) == {"hum_hz": 12}
    assert scene.receiver.lost_share == 0.01
    assert scene.background[0].probability == 0.5
    (step,), choice = scene.steps
    assert (step.least_s, step.most_s, len(step.actors)) == (2, 4, 2)
    assert [s.weight for s in choice] == [2, 1]


FAULTS = [
    ("", "must be a mapping with the keys description, like, steps, background"),
    ("steps: []\n", "steps: must be a list with at least one step"),
    (
        STEP + "colour: red\n",
        ".colour: unknown key; did you mean clutter? known are description, like",
    ),
    (STEP + "description: [a, b]\n", "description: must be text"),
    (STEP + "clutter: wall\n", "clutter: must be a list"),
    (STEP + "clutter: [{range_m: 0, rcs_m2: 1}]\n", "clutter[0].range_m: 0 is not in 0.1 to 1000"),
    ("steps: [walk]\n", "steps[0]: must be a mapping with the keys duration_s, actors"),
    ("steps: [{body: thesis_cat}]\n", "steps[0].duration_s: must be a number"),
    ("steps: [{duration_s: 1e3}]\n", "steps[0].duration_s: must be a number, not '1e3'"),
    ("steps: [{duration_s: .nan}]\n", "steps[0].duration_s: nan is not in"),
    ("steps: [{duration_s: 1" + "0" * 400 + "}]\n", "steps[0].duration_s: 1000"),
    ("steps: [{duration_s: 1" + "0" * 5000 + "}]\n", "not YAML"),
    (
        "steps: [{body: horse, duration_s: 1}]\n",
        "steps[0].body: no body 'horse'; known are human, cat",
    ),
    ("steps: [{body: [thesis_cat], duration_s: 1}]\n", "steps[0].body: no body"),
    ("steps: [{body: thesis_cat, style: walk, duration_s: 1}]\n", "steps[0].style: unknown key"),
    ("steps: [{body: thesis_cat, thing: fan, duration_s: 1}]\n", "name one body or one thing"),
    ("steps: [{thing: fan, duration_s: 1}]\n", "steps[0].position_m"),
    ("steps: [{thing: fan, position_m: [0, 2], rate: 3, duration_s: 1}]\n", "steps[0].rate"),
    ("steps: [{duration_s: [2, 1]}]\n", "steps[0].duration_s: 2 is above 1"),
    ("steps: [{duration_s: [[[1]], 2]}]\n", "steps[0].duration_s: must be a number, not [[1]]"),
    ("steps: [{body: human, duration_s: 1, course: {a: 1}}]\n", "steps[0].course"),
    ("like: [dog]\n", "like: no built-in scene '['dog']'"),
    ("steps: [{one_of: []}]\n", "steps[0].one_of: must be a list with at least one"),
    ("steps: [{one_of: [{duration_s: 1, weight: -1}]}]\n", "steps[0].one_of[0].weight: -1"),
    ("steps: [{duration_s: 1, actors: [{}]}]\n", "steps[0].actors[0]: must name one body"),
    ("steps: [{duration_s: 1, actors: [{body: thesis_cat, probability: 2}]}]\n", "probability: 2"),
    (STEP + "antenna: {height_m: -1}\n", "antenna.height_m: -1 is not in"),
    (STEP + "surfaces: [{axis: w}]\n", "surfaces[0].axis: must be one of x, y, z"),
    (STEP + "background: [{thing: ghost}]\n", "background[0].thing: no thing 'ghost'"),
    (STEP + "error_db: -30\n", "error_db: -30 is not in -100 to -40"),
    ("steps: []\nsteps: []\n", "the key 'steps' stands twice, in lines 1 and 2"),
    ("steps: !!python/object/apply:os.getcwd []\n", "not YAML"),
]


@pytest.mark.parametrize(("text", "wanted"), FAULTS, ids=range(len(FAULTS)))
def test_faults_of_a_file_are_one_line_with_the_path_of_the_key(tmp_path, text, wanted):
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        load_scene(str(path))
    message = str(caught.value)
    assert message.startswith(f"{path}")
    assert wanted in message
    assert "\n" not in message
    assert caught.value.exit_code == 66


def test_files_that_cannot_be_read(tmp_path):
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(bytes(range(256)))
    for name in (binary, tmp_path / "missing.yaml", "nul\0.yaml"):
        with pytest.raises(SceneError, match="cannot read the scene file"):
            load_scene(str(name))
    for name in ("humans", "", "human.yam", "../scenes/human"):
        with pytest.raises(SceneError, match=f"'{name}'.*'x2radar scenes' lists them"):
            load_scene(name)


@given(st.text(max_size=80))
def test_any_text_is_a_scene_or_a_scene_error(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    with pytest.raises(SceneError):
        load_scene(str(path))


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
