"""A scene played for a radar: blocks, draws, time, and the ways of the echoes."""

from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim.test_sim_scene import FULL
from x2radar.errors import SceneError
from x2radar.modules.x2 import RadarSettings
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import builtin_scenes, parse_scene
from x2radar.sim.scene.stage import Stage, check_swath

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
    n_dogs = sum(b.n_slow == 180 for b in blocks[1::2])
    assert 8 <= n_dogs <= 18
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
