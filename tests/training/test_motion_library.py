"""Recorded motion: clips as they were, along any course, and a folder of them as bodies."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.training.motion_helpers import RATE_HZ, stander, walker, write_clip
from x2radar.errors import SceneError, SettingsError
from x2radar.sim.bodies.skins import SKINS
from x2train.cli import main
from x2train.motion.clips import read_clip, read_clips
from x2train.motion.library import cards_of, draw_recorded_body, perform, read_library
from x2train.sets.families import CLIPS, draw_cast, draw_goer, recorded_families
from x2train.sets.shards import read_all

T_S = np.arange(0.0, 6.0, 1 / 60)
ANTENNA_M = np.array([0.0, 0.0, 1.0])
STRAIGHT = [(0.0, 1.0), (0.0, 30.0)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("library")
    write_clip(made / "walk.npz", walker(), "person", "anna", licence="CC0", source="made here")
    write_clip(made / "fast.npz", walker(speed_mps=1.6, stride_s=0.95), "person", "anna")
    write_clip(made / "stand.npz", stander(), "quadruped", "rex")
    write_clip(made / "rex_death.npz", stander(), "quadruped", "rex", action="death")
    return made


def test_individuals_go_or_stay_and_nobody_dies(folder, tmp_path):
    anna, rex = read_library(folder)
    assert (anna.name, anna.label, anna.goes) == ("anna goes", "human", True)
    assert (rex.name, rex.label, rex.goes) == ("rex stays", "pet", False)
    assert [clip.name for clip in rex.clips] == ["stand"]
    # What was recorded of an animal counts more than what is animated, even if nothing slides.
    write_clip(tmp_path / "idle.npz", stander(), "quadruped", "toy", slip_ratio=0.0)
    assert rex.weight == 4 * read_library(tmp_path)[0].weight > anna.weight
    rows = cards_of([anna, rex])
    assert [row["clip"] for row in rows] == ["fast", "walk", "stand"]
    assert ({len(row["sha256"]) for row in rows}, rows[1]["licence"]) == ({64}, "CC0")
    # Casts are of the folder, and things stay simulated.
    rng, use = np.random.default_rng(0), f"{CLIPS}{folder}"
    assert [f.name for f in recorded_families(str(folder))] == ["anna goes", "rex stays"]
    with pytest.raises(SettingsError, match="no pet goes anywhere"):
        draw_goer(rng, "pet", use)
    (who,), (pet,), (thing,) = (draw_cast(rng, label, use) for label in ("human", "pet", "other"))
    assert (who.name, who.stays, pet.name, pet.stays) == ("anna goes", False, "rex stays", True)
    assert thing.plugged is None


@pytest.mark.parametrize("skin", SKINS)
@pytest.mark.parametrize("who", [0, 1])
def test_bodies_echo_through_every_skin(folder, skin, who):
    individual = read_library(folder)[who]
    options = {"skin": skin, "near_m": 0.6, "far_m": 3.4}
    for seed in range(3):
        draws = (np.random.default_rng(seed) for _ in range(2))
        body, same = (draw_recorded_body(individual, rng, options, "here") for rng in draws)
        assert body.label == individual.label
        points, again = body.at(T_S, ANTENNA_M), same.at(T_S, ANTENNA_M)
        np.testing.assert_array_equal(points.position_m, again.position_m)
        assert points.position_m.shape == (len(T_S), len(body.names), 3)
        assert 0 <= points.rcs_m2.min() <= points.rcs_m2.max() < np.inf
        assert points.position_m[..., 2].max() < (2.1 if who == 0 else 1.0)


def test_a_slow_body_takes_less_than_three_quarters_of_its_tempo(folder):
    def way_m(seed, **slow):
        options = {"near_m": 0.6, "far_m": 3.4, **slow}
        rng = np.random.default_rng(seed)
        body = draw_recorded_body(read_library(folder)[0], rng, options, "here")
        place_m = body.at(T_S, ANTENNA_M).position_m[:, 0, :2]
        return np.linalg.norm(np.diff(place_m, axis=0), axis=1).sum()

    ways = np.array([[way_m(seed), way_m(seed, slow=True)] for seed in range(8)])
    # The usual tempo is 0.75 to 1.15.
    assert (ways[:, 1] < ways[:, 0]).all()
    assert 0.3 < (ways[:, 1] / ways[:, 0]).mean() < 0.7


@pytest.mark.integration
def test_a_set_of_recorded_motion_is_the_same_for_any_number_of_workers(folder, tmp_path, capsys):
    words = ["dataset", "--clips", str(folder), "--passages", "6", "--radar", "x2"]
    for n in ("1", "2"):
        assert main([*words, "--workers", n, "--out", str(tmp_path / n)]) == 0
    (_, one), (_, two) = (read_all(tmp_path / n) for n in ("1", "2"))
    np.testing.assert_equal(one, two)
    (tmp_path / "none").mkdir()
    out = ["--out", str(tmp_path / "set")]
    assert main(["dataset", "--clips", str(tmp_path / "none"), *out]) == 66
    assert "no clips" in capsys.readouterr().err
    assert main(["dataset", "--slow", "1", *out]) == 2
    assert "--slow: is of recorded bodies" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


def test_a_clip_says_whose_it_is_and_how_large(folder):
    fast, _, stand, walk = read_clips(folder)
    assert (walk.individual, walk.source, stand.individual) == ("anna", "made here", "rex")
    assert walk.size_m == pytest.approx(1.8, abs=0.01)
    assert stand.size_m == pytest.approx(0.54, abs=0.01)
    assert fast.step_m.mean() * RATE_HZ == pytest.approx(1.6, rel=0.02)
    assert stand.step_m.max() == 0.0


def test_on_a_straight_course_the_recording_itself_is_played(folder):
    played = perform(np.random.default_rng(0), [read_clip(folder / "walk.npz")], duration_s=1.0)
    joint_m = played.along(STRAIGHT, 0.5)
    # Turned to the course, which goes along y.
    whole = walker()
    ways = [
        np.abs(joint_m[:, :, 1] - whole[k : k + len(joint_m), :, 0] - off).max()
        for k in range(len(whole) - len(joint_m))
        for off in [joint_m[0, 0, 1] - whole[k, 0, 0]]
    ]
    assert min(ways) < 0.01
    np.testing.assert_allclose(joint_m[..., 2].min(), whole[..., 2].min(), atol=1e-6)


def feet_speed(joint_m, clip, rate_hz):
    at = [clip.joints.index(f"{s}_ankle") for s in "lr"]
    return np.linalg.norm(np.diff(joint_m[:, at, :2], axis=0), axis=-1) * rate_hz


def test_feet_stand_still_as_long_as_in_the_clip_and_a_mirror_swaps_the_sides(folder):
    clips = [read_clip(folder / name) for name in ("walk.npz", "fast.npz")]
    played = perform(np.random.default_rng(3), clips, duration_s=20.0)
    speed = feet_speed(played.along(STRAIGHT, 0.5), clips[0], played.frame_rate_hz)
    # Half of the time but for fades.
    assert (speed < 0.1).mean() > 0.4
    clip = read_clip(folder / "walk.npz")
    seen = clip.mirrored()
    left, right = (clip.joints.index(f"{s}_knee") for s in "lr")
    np.testing.assert_array_equal(seen.joint_m[:, left, 0], clip.joint_m[:, right, 0])
    np.testing.assert_array_equal(seen.joint_m[:, left, 1], -clip.joint_m[:, right, 1])
    np.testing.assert_array_equal(seen.mirrored().joint_m, clip.joint_m)


@given(
    seed=st.integers(0, 2**32),
    scale=st.floats(0.5, 1.5),
    tempo=st.floats(0.7, 1.5),
    radius_m=st.floats(0.3, 1.0),
)
def test_nothing_jumps_whatever_is_drawn(folder, seed, scale, tempo, radius_m):
    clips = [read_clip(folder / name) for name in ("walk.npz", "fast.npz")]
    rng = np.random.default_rng(seed)
    played = perform(rng, clips, duration_s=12.0, scale=scale, tempo=tempo)
    joint_m = played.along([(0.0, 1.0), (2.0, 2.5), (-1.0, 3.0)], radius_m, rng.uniform(-2, 2))
    assert len(joint_m) / played.frame_rate_hz >= 12.0
    assert np.isfinite(joint_m).all()
    assert (np.diff(played.way_m) >= 0).all()
    speed = np.linalg.norm(np.diff(joint_m, axis=0), axis=-1) * played.frame_rate_hz
    # A swinging foot goes at four times the walker's speed; corners and fades add to it.
    assert speed.max() < 14.0 * scale * tempo


@pytest.mark.parametrize("text", [b"", b"PK\3\4 cut", b"\x93NUMPY"])
def test_what_is_no_clip_is_said_in_one_line(tmp_path, text):
    path = tmp_path / "bad.npz"
    path.write_bytes(text)
    with pytest.raises(SceneError, match=r"bad\.npz: not a clip") as caught:
        read_clip(path)
    assert "\n" not in str(caught.value)
