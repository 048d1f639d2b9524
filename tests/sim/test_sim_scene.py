"""What a scene may say and costs, its numbers and things, and what is played of it for a radar."""

import math
from dataclasses import fields
from functools import partial
from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import bench_scene
from x2radar.cli import main
from x2radar.errors import SceneError, SettingsError
from x2radar.keys import settings_from
from x2radar.modules.x2 import RadarSettings
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.sim.module import cost, stream
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.place.antenna import Antenna, Surface, TailSettings
from x2radar.sim.place.room import RoomSettings
from x2radar.sim.scene.cast import BODIES
from x2radar.sim.scene.scene import ERRORS_DB, builtin_scenes, load_scene, parse_scene, scene_names
from x2radar.sim.scene.stage import Stage, check_swath
from x2radar.sim.signal.receiver import ReceiverEffects
from x2radar.sim.things.draws import DRAWS, draw_mount
from x2radar.sim.things.kinds import THINGS, draw_thing

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
    ("steps: [{body: ox, duration_s: 1}]\n", "steps[0].body: no body 'ox'; known are human, cat"),
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


def test_the_bill_has_what_the_scene_names_and_nothing_else():
    names = [name for name, _ in cost.parts(parse_scene(FULL, "full", "full"))]
    assert names == [
        *("body: thesis_human", "thing: fan", "body: thesis_dog", "thing: curtain"),
        *("antenna's pattern", "multipath: surfaces", "room", "multipath: tail", "mount"),
        *("receiver: jitter_s", "receiver: gain_noise", "receiver: lost_share"),
    ]
    assert {name.removeprefix("thing: ") for name in names if "thing" in name} <= set(THINGS)
    assert not list(cost.parts(parse_scene("steps: [{duration_s: 9}]\n", "t", "t")))


@pytest.mark.parametrize("bound_db", ERRORS_DB)
def test_a_scene_bounds_its_echoes_error(monkeypatch, bound_db):
    asked, made = [], stream.echo_frames

    def noted(*args, error_db, **how):
        asked.append(error_db)
        return made(*args, error_db=error_db, **how)

    monkeypatch.setattr(stream, "echo_frames", noted)
    text = f"steps: [{{body: thesis_cat, duration_s: 9}}]\nerror_db: {bound_db:g}"
    stream.EchoStream(parse_scene(text, "t", "t"), 0, RadarSettings(output="iq")).next()
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


SCENE = parse_scene(
    "steps: [{body: thesis_human, duration_s: 1}, {duration_s: 0.5},"
    " {body: thesis_cat, duration_s: 0.25}]",
    "test",
    "test",
)
WHOLE = parse_scene(FULL, "full", "full")


def frames_of(scene, seed, sizes, *, rate_hz=60.0):
    """(ranges, roots of cross sections) of single frames, in blocks of at most `sizes`."""
    stage = Stage(scene, seed, rate_hz)
    for most in sizes:
        rows = stage.next_block(most).rows
        assert 1 <= len(rows.range_m) <= most
        yield from zip(rows.range_m, rows.root_rcs_m, strict=True)


def same(a, b):
    return all(np.allclose(x, y, rtol=1e-9, atol=1e-12) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("scene", [SCENE, WHOLE], ids=["plain", "full"])
@settings(max_examples=20)
@given(st.lists(st.integers(1, 60), min_size=1, max_size=4), st.integers(0, 2**40))
def test_blocks_of_any_size_give_the_same_frames(scene, sizes, seed):
    frames = list(frames_of(scene, seed, sizes))
    single = islice(frames_of(scene, seed, [7] * 5000), len(frames))
    assert all(same(a, b) for a, b in zip(frames, single, strict=True))


def test_blocks_end_where_steps_end_and_a_step_is_a_frame_at_least():
    stage = Stage(SCENE, 0, 60.0)
    shapes = [stage.next_block(1000).rows.range_m.shape for _ in range(6)]
    assert shapes == [(60, 5), (30, 0), (15, 5)] * 2
    scene = parse_scene("steps: [{duration_s: 0.1}, {duration_s: 0.1}]", "short", "short")
    stage = Stage(scene, 0, 1.0)
    assert [stage.next_block(10).n_slow for _ in range(4)] == [1, 1, 1, 1]


def test_durations_and_choices_are_drawn_anew():
    stage = Stage(WHOLE, 5, 60.0)
    blocks = [stage.next_block(10_000) for _ in range(40)]
    first = [b.n_slow for b in blocks[::2]]
    assert len(set(first)) > 10
    assert all(120 <= n <= 240 for n in first)
    assert 8 <= sum(b.n_slow == 180 for b in blocks[1::2]) <= 18
    assert all(b.n_slow in {60, 180} for b in blocks[1::2])


def test_what_is_named_adds_rows_and_nothing_else_does():
    plain = Stage(SCENE, 0, 60.0).next_block(4)
    assert (plain.rows.range_m.shape[1], plain.offset_m) == (5, None)
    more = "surfaces: [{axis: z}]\ntail: {n_paths: 16}\nmount: {}\n"
    text = "steps: [{body: thesis_human, duration_s: 1}]\n" + more
    block = Stage(parse_scene(text, "t", "t"), 0, 60.0).next_block(4)
    assert block.rows.range_m.shape[1] == 5 + 2 * 5 + 16
    assert block.offset_m.shape == (4, 3)


@pytest.mark.parametrize("output", ["rf", "iq"])
def test_a_full_scene_makes_the_same_frames_again_and_loses_some(output):
    streams = [EchoStream(WHOLE, 3, RadarSettings(output=output)) for _ in range(2)]
    pairs = [tuple(stream.next() for stream in streams) for _ in range(300)]
    assert 0 < sum(a is None for a, _ in pairs) < 15
    for a, b in pairs:
        assert a is b is None or (np.array_equal(a, b) and np.isfinite(a).all())


@pytest.mark.parametrize(
    "actor",
    [
        "{body: dog, waypoints_m: [[0, 9], [3, 9]]}",
        "{thing: fan, position_m: [0, 20]}",
        "{body: bird, home_m: [0, 15, 1]}",
    ],
)
def test_what_never_enters_the_swath_is_named(actor, tmp_path):
    path = tmp_path / "far.yaml"
    path.write_text(f"steps: [{{duration_s: 2}}, {{duration_s: 5, actors: [{actor}]}}]")
    with pytest.raises(SceneError, match=r"far.yaml: steps\[1\].actors\[0\]: the .* never"):
        make_radar(parse_port(f"sim:{path}"))


def test_builtin_scenes_are_in_the_swath_of_every_module():
    for scene in builtin_scenes():
        check_swath(scene, 0.6, 3.4)


CLASSES = (Antenna, Surface, TailSettings, RoomSettings, ReceiverEffects)
FIELDS = [(cls, field.name, field.metadata["key"]) for cls in CLASSES for field in fields(cls)]
PLACE = (0.3, 2.0)


def wrong_values(low, high):
    step = 1e-3 * max(abs(low), abs(high), 1e-3)
    return [low - step, high + step, math.nan, math.inf, 10**400, "loud", True, [1]]


@pytest.mark.parametrize(("cls", "name", "key"), FIELDS)
def test_what_no_setting_may_be_is_named_in_code_and_in_a_scene(cls, name, key):
    wrong = ["pink", 7, None] if key.choices else wrong_values(key.low, key.high)
    wrong += [key.low + 0.5] if key.is_whole else []
    for value in wrong:
        with pytest.raises(SettingsError, match=f"^{name} = ") as code:
            cls(**{name: value})
        with pytest.raises(SceneError, match=rf"^x.yaml: part\.{name}: ") as scene:
            settings_from(cls, {name: value}, "x.yaml: part")
        assert "\n" not in str(code.value) + str(scene.value)
    for value in [*key.choices] or [key.low, key.high]:
        if (cls, name) != (TailSettings, "free_m") and (cls, name, value) != (
            TailSettings,
            "reach_m",
            key.low,
        ):
            assert getattr(settings_from(cls, {name: value}, ""), name) == value
    if key.is_optional:
        assert getattr(settings_from(cls, {name: None}, ""), name) is None


def test_all_faults_at_once_unknown_keys_and_nothing():
    with pytest.raises(SettingsError, match=r"jitter_s = .*; lost_share = "):
        ReceiverEffects(jitter_s=-1, lost_share=2)
    words = r"^receiver\.jiter_s: unknown key; did you mean jitter_s"
    with pytest.raises(SceneError, match=words):
        settings_from(ReceiverEffects, {"jiter_s": 0}, "receiver")
    with pytest.raises(SceneError, match=r"^receiver: must be a mapping"):
        settings_from(ReceiverEffects, [1], "receiver")
    assert settings_from(ReceiverEffects, None, "receiver") == ReceiverEffects()


NUMBERS = [(kind, name) for kind, thing in THINGS.items() for name in thing.draws]


@pytest.mark.parametrize(("kind", "name"), [*NUMBERS, *(("mount", name) for name in DRAWS)])
def test_what_no_number_of_a_thing_may_be_is_named_with_its_path(kind, name):
    rng = np.random.default_rng(0)
    make = partial(draw_mount, rng) if kind == "mount" else partial(draw_thing, rng, kind, PLACE)
    limits = DRAWS[name] if kind == "mount" else THINGS[kind].draws[name]
    assert limits.low <= limits.usual[0] <= limits.usual[1] <= limits.high
    for value in [*wrong_values(limits.low, limits.high), None]:
        with pytest.raises(SceneError, match=rf"^a.yaml: it\.{name}: ") as caught:
            make({name: value}, "a.yaml: it")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("kind", "place", "said", "words"),
    [
        ("door", PLACE, {"widht_m": 1}, r"widht_m: unknown key; did you mean width_m\?"),
        ("door", "here", None, "position_m: must be 2 numbers"),
        ("door", (1, 2, 3), None, "position_m: must be 2 numbers"),
        ("door", None, None, "position_m: must be 2 numbers"),
        ("door", (1, math.nan), None, r"position_m\[1\]: nan is not in"),
        ("door", (-1000, 1), None, r"position_m\[0\]: -1000 is not in"),
        ("door", ("x", 1), None, r"position_m\[0\]: must be a number"),
    ],
)
def test_keys_and_places_of_things(kind, place, said, words):
    with pytest.raises(SceneError, match=rf"^thing\.{words}"):
        draw_thing(np.random.default_rng(0), kind, place, said)


HERE = np.array([0.0, 0.0, 1.5])
KINDS = sorted(THINGS)


def thing(kind, seed=0, **said):
    return draw_thing(np.random.default_rng(seed), kind, PLACE, said, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_both_ends_of_every_number_work(kind):
    for end in ("low", "high"):
        said = {name: getattr(d, end) for name, d in THINGS[kind].draws.items()}
        p = thing(kind, **said).at(np.linspace(0, 20, 40), HERE)
        assert np.isfinite(p.position_m).all()
        assert np.isfinite(p.rcs_m2).all()
        assert (p.rcs_m2 >= 0).all()


@settings(max_examples=40)
@given(st.sampled_from(KINDS), st.integers(0, 2**32), st.floats(0, 1e6))
def test_nothing_jumps(kind, seed, begin_s):
    """Half a millisecond moves no point further than the fastest blade."""
    ours = thing(kind, seed)
    t_s = begin_s + np.arange(100) * 5e-4
    step_m = np.linalg.norm(np.diff(ours.at(t_s, HERE).position_m, axis=0), axis=-1)
    seen = ours.at(t_s, HERE).rcs_m2
    step_m = step_m[(seen[1:] > 0) & (seen[:-1] > 0)]
    fastest_mps = 2 * np.pi * 25 * 0.25 if kind == "fan" else 3.0
    assert step_m.max(initial=0.0) < fastest_mps * 5e-4 * 1.05


def test_fan_blades_turn_on_circles_and_make_a_comb():
    t_s = np.arange(0, 4, 1 / 400)
    said = {"rotation_hz": 5.0, "n_blades": 3, "radius_m": 0.2, "swing_deg": 0}
    p = thing("fan", heading_deg=120, **said).at(t_s, HERE)
    hub, tip = p.position_m[:, 0], p.position_m[:, 2 + 2]
    assert np.linalg.norm(tip - hub, axis=1) == pytest.approx(np.full(t_s.size, 0.2))
    assert np.ptp(hub, axis=0).max() == 0
    rows = Antenna(shape="isotropic").direct(p)
    track = (rows.root_rcs_m * np.exp(-2j * np.pi * 2 * rows.range_m / 0.0441)).sum(axis=1)
    power = np.abs(np.fft.fft((track - track.mean()) * np.hanning(t_s.size))) ** 2
    hz = np.fft.fftfreq(t_s.size, 1 / 400)
    on_comb = np.abs((np.abs(hz) + 2.5) % 5 - 2.5) < 0.6
    assert power[on_comb].sum() > 0.95 * power.sum()
    assert np.count_nonzero(power[on_comb] > power.max() / 100) > 10


def mount(seed=0, **said):
    return draw_mount(np.random.default_rng(seed), said)


def test_mount_has_no_state_and_obeys_its_seed():
    t_s = np.random.default_rng(0).uniform(0, 1e4, 100)
    whole = mount(3)(t_s)
    assert mount(3)(t_s[::-1])[::-1] == pytest.approx(whole, abs=1e-15)
    assert not np.array_equal(mount(4)(t_s), whole)
    limit = sum(DRAWS[k].usual[1] for k in ("hum_m", "sway_m", "shock_m", "shock_m"))
    assert np.linalg.norm(whole, axis=1).max() <= limit
    assert not mount(hum_m=0, sway_m=0, shock_m=0)(t_s).any()
