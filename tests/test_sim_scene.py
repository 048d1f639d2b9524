from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from x2radar.errors import SceneError
from x2radar.sim.motion import SEED_BODIES, draw, ranges
from x2radar.sim.scene import Scene, SceneClock, SceneStep, builtin_scenes, load_scene

BUILTIN = ["cat", "demo", "dog", "empty", "human"]
STEP = "steps: [{body: seed_cat, duration_s: 5}]\n"


# ---------------------------------------------------------------- files


def test_builtin_scenes():
    scenes = builtin_scenes()
    assert [scene.name for scene in scenes] == BUILTIN
    for scene in scenes:
        assert load_scene(scene.name) == scene
        assert scene.description
        assert scene.description == " ".join(scene.description.split())
        assert sum(step.duration_s for step in scene.steps) > 0
        for step in scene.steps:
            assert step.body is None or step.body in SEED_BODIES


def test_a_file_says_the_same_as_a_builtin_scene(tmp_path):
    path = tmp_path / "room.yml"
    path.write_text(
        "description: >\n  A room,\n  in two lines.\n"
        "steps:\n  - {body: seed_dog, duration_s: 2}\n  - {body: null, duration_s: 1.5}\n"
        "clutter:\n  - {range_m: 1, rcs_m2: 2.5e+3}\n"
    )
    scene = load_scene(str(path))
    assert scene.name == "room"
    assert scene.description == "A room, in two lines."
    assert scene.steps == (SceneStep("seed_dog", 2.0), SceneStep(None, 1.5))
    assert [(p.range_m, p.rcs_m2) for p in scene.clutter] == [(1.0, 2500.0)]


def test_description_and_clutter_may_be_left_out_or_empty(tmp_path):
    path = tmp_path / "s.yaml"
    for more in ("", "description:\nclutter:\n", "clutter: []\n"):
        path.write_text(STEP + more)
        scene = load_scene(str(path))
        assert (scene.description, scene.clutter) == ("", ())


FAULTS = [
    ("", "must be a mapping with the keys clutter, description, steps"),
    ("# nothing but a comment\n", "must be a mapping"),
    ("- 1\n- 2\n", "must be a mapping"),
    ("steps: {}\n", "steps: must be a list"),
    ("steps: []\n", "steps: must be a list with at least one step"),
    ("description: only words\n", "steps: must be a list"),
    (STEP + "colour: red\n", ".colour: unknown key; known are clutter, description, steps"),
    (STEP + "1: 2\n", ".1: unknown key"),
    (STEP + "description: [a, b]\n", "description: must be text"),
    (STEP + "description: 2020-13-45\n", "not YAML"),
    (STEP + "clutter: wall\n", "clutter: must be a list"),
    (STEP + "clutter: 0\n", "clutter: must be a list"),
    (STEP + "clutter: {range_m: 1, rcs_m2: 1}\n", "clutter: must be a list"),
    (STEP + "clutter: [3]\n", "clutter[0]: must be a mapping with the keys range_m, rcs_m2"),
    (STEP + "clutter: [{range_m: 1}]\n", "clutter[0].rcs_m2: must be a number"),
    (STEP + "clutter: [{range_m: 0, rcs_m2: 1}]\n", "clutter[0].range_m: 0 is not in 0.1 to 1000"),
    (STEP + "clutter: [{range_m: 1, rcs_m2: -1}]\n", "clutter[0].rcs_m2: -1 is not in 0 to 1e+09"),
    ("steps: [walk]\n", "steps[0]: must be a mapping with the keys body, duration_s"),
    ("steps: [{duration_s: 1}, {duration: 1}]\n", "steps[1].duration: unknown key"),
    ("steps: [{body: seed_cat}]\n", "steps[0].duration_s: must be a number"),
    ("steps: [{duration_s: '5'}]\n", "steps[0].duration_s: must be a number"),
    ("steps: [{duration_s: true}]\n", "steps[0].duration_s: must be a number"),
    ("steps: [{duration_s: null}]\n", "steps[0].duration_s: must be a number"),
    ("steps: [{duration_s: -5}]\n", "steps[0].duration_s: -5 is not in 0.1 to 86400"),
    ("steps: [{duration_s: 0}]\n", "steps[0].duration_s: 0 is not in"),
    ("steps: [{duration_s: 1e3}]\n", "steps[0].duration_s: must be a number, not '1e3'"),
    ("steps: [{duration_s: 86401}]\n", "steps[0].duration_s: 86401 is not in"),
    ("steps: [{duration_s: .nan}]\n", "steps[0].duration_s: nan is not in"),
    ("steps: [{duration_s: .inf}]\n", "steps[0].duration_s: inf is not in"),
    ("steps: [{duration_s: 1" + "0" * 400 + "}]\n", "steps[0].duration_s: 1000"),
    ("steps: [{duration_s: 1" + "0" * 5000 + "}]\n", "not YAML"),
    ("steps: [{body: horse, duration_s: 1}]\n", "steps[0].body: no body 'horse'; known are seed_"),
    ("steps: [{body: '', duration_s: 1}]\n", "steps[0].body: no body ''"),
    ("steps: [{body: 7, duration_s: 1}]\n", "steps[0].body: no body '7'"),
    ("steps: [{body: [seed_cat], duration_s: 1}]\n", "steps[0].body: no body"),
    ("steps: [{body: {a: 1}, duration_s: 1}]\n", "steps[0].body: no body"),
    ("steps: [\n", "not YAML"),
    ("\tsteps: 1\n", "not YAML"),
    ("steps: !!python/object/apply:os.getcwd []\n", "not YAML"),
    ("[" * 5000, "not YAML"),
    ("a\0b: 1\n", "not YAML"),
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
    folder = tmp_path / "folder.yaml"
    folder.mkdir()
    for name in (binary, folder, tmp_path / "missing.yaml", "nul\0.yaml"):
        with pytest.raises(SceneError, match="cannot read the scene file"):
            load_scene(str(name))


@pytest.mark.parametrize("name", ["humans", "", "human.yam", "../scenes/human"])
def test_unknown_scene_names_the_known_ones(name):
    with pytest.raises(SceneError, match="cat, demo, dog, empty, human") as caught:
        load_scene(name)
    assert f"'{name}'" in str(caught.value)


@given(st.text(max_size=80))
def test_any_text_is_a_scene_or_a_scene_error(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    with pytest.raises(SceneError):
        load_scene(str(path))


# ---------------------------------------------------------------- clock


SCENE = Scene(
    "test",
    "",
    (SceneStep("seed_human", 1.0), SceneStep(None, 0.5), SceneStep("seed_cat", 0.25)),
)


def frames_of(scene, seed, sizes, *, rate_hz=60.0):
    """(ranges, cross sections) of single frames, taken in blocks of at most `sizes`."""
    clock = SceneClock(scene, seed, rate_hz)
    for most in sizes:
        block = clock.next_block(most)
        assert 1 <= len(block.range_m) <= most
        for row in block.range_m:
            yield row, block.rcs_m2


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@given(st.lists(st.integers(1, 100), min_size=1, max_size=30), st.integers(0, 2**40))
def test_blocks_of_any_size_give_the_same_frames(sizes, seed):
    frames = list(frames_of(SCENE, seed, sizes))
    single = islice(frames_of(SCENE, seed, [1] * 5000), len(frames))
    assert all(same(a, b) for a, b in zip(frames, single, strict=True))


def test_blocks_end_where_steps_end():
    clock = SceneClock(SCENE, 0, 60.0)
    blocks = [clock.next_block(1000) for _ in range(7)]
    assert [b.range_m.shape for b in blocks[:3]] == [(60, 5), (30, 0), (15, 5)]
    assert [b.range_m.shape for b in blocks[3:6]] == [(60, 5), (30, 0), (15, 5)]


def test_every_step_is_a_draw_of_its_own_number():
    clock = SceneClock(SCENE, 9, 60.0)
    for number, (body, n) in enumerate([("seed_human", 60), (None, 30), ("seed_cat", 15)] * 3):
        block = clock.next_block(1000)
        drawn = draw(SEED_BODIES[body], np.random.default_rng([9, number])) if body else ()
        range_m, rcs_m2 = ranges(drawn, np.arange(n) / 60)
        assert np.array_equal(block.range_m, range_m)
        assert np.array_equal(block.rcs_m2, rcs_m2)


def test_repeats_bring_other_draws_and_seeds_other_scenes():
    clock = SceneClock(SCENE, 0, 60.0)
    blocks = [clock.next_block(1000) for _ in range(6)]
    assert not np.array_equal(blocks[0].range_m, blocks[3].range_m)
    assert not np.array_equal(blocks[0].rcs_m2, blocks[3].rcs_m2)
    other = SceneClock(SCENE, 1, 60.0).next_block(1000)
    assert not np.array_equal(blocks[0].range_m, other.range_m)


def test_a_step_is_never_shorter_than_a_frame():
    scene = Scene("short", "", (SceneStep("seed_cat", 0.1), SceneStep(None, 0.1)))
    clock = SceneClock(scene, 0, 1.0)
    assert [len(clock.next_block(10).range_m) for _ in range(4)] == [1, 1, 1, 1]


@pytest.mark.parametrize("rate_hz", [1.0, 60.0, 1000.0])
def test_time_runs_with_the_frame_rate(rate_hz):
    scene = Scene("long", "", (SceneStep("seed_dog", 100.0),))
    range_m = np.array([row for row, _ in frames_of(scene, 3, [7] * 14, rate_hz=rate_hz)])
    drawn = draw(SEED_BODIES["seed_dog"], np.random.default_rng([3, 0]))
    assert np.array_equal(range_m, ranges(drawn, np.arange(98) / rate_hz)[0])
