"""Recorded motion: a small BVH file of our own, archives, and what is wrong with files."""

import numpy as np
import pytest

from x2radar.errors import SceneError
from x2radar.sim.bodies.motion.recorded import read_motion
from x2radar.sim.scene.scene import parse_scene

# A trunk of 50 cm on a root, with an arm of 40 cm; y is up, centimetres, 10 frames a second.
BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Chest
  {
    OFFSET 0 50 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Arm
    {
      OFFSET 10 0 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 40 0 0
      }
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.1
0 100 300 0 0 0  0 0 0  0 0 0
0 100 290 0 0 0  0 0 0  90 0 0
0 100 280 0 0 90  0 0 0  0 0 0
"""


@pytest.fixture
def walk(tmp_path):
    file = tmp_path / "walk.bvh"
    file.write_text(BVH)
    return file


def test_forward_kinematics_by_hand(walk):
    motion = read_motion(str(walk), scale=0.01)
    assert motion.names == ("Chest", "Arm", "Arm end")
    assert motion.frame_rate_hz == pytest.approx(10.0)
    hips, chest, arm, hand = (motion.position_m[:, k] for k in range(4))
    # The file's (x, y up, z) is the room's (x, -z, up).
    assert hips == pytest.approx(np.array([[0, -3, 1], [0, -2.9, 1], [0, -2.8, 1]]))
    assert chest[:, 2] == pytest.approx([1.5, 1.5, 1.5])
    assert hand[0] - arm[0] == pytest.approx([0.4, 0, 0])
    assert hand[1] - arm[1] == pytest.approx([0, 0, 0.4])  # a turn of 90 degrees about z lifts it
    assert hand[2] - arm[2] == pytest.approx([0, 0.4, 0])  # about the vertical: towards -z
    assert motion.half_m[:, 0] == pytest.approx([0.25, 0.05, 0.2])


def test_between_frames_positions_are_interpolated_and_ends_stand(walk):
    motion = read_motion(str(walk), scale=0.01)
    centre, axis, side = motion.posture(np.array([-1.0, 0.05, 9.0]))
    assert centre[0, 0] == pytest.approx([0, -3, 1.25])
    assert centre[1, 0] == pytest.approx([0, -2.95, 1.25])
    assert centre[2, 0] == pytest.approx([0, -2.8, 1.25])
    assert np.linalg.norm(axis, axis=-1) == pytest.approx(np.ones((3, 3)))
    assert (axis * side).sum(axis=-1) == pytest.approx(np.zeros((3, 3)), abs=1e-12)


def test_an_archive_says_the_same(walk, tmp_path):
    motion = read_motion(str(walk), scale=0.01)
    file = tmp_path / "walk.npz"
    np.savez(file, position_m=motion.position_m, parent=[-1, 0, 1, 2], frame_rate_hz=10.0)
    again = read_motion(str(file), up="z")
    t_s = np.linspace(0, 0.2, 7)
    for ours, theirs in zip(motion.posture(t_s), again.posture(t_s), strict=True):
        assert ours == pytest.approx(theirs)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "cut short|no line MOTION"),
        (BVH.replace("MOTION", "NOTION"), "'NOTION' is no word"),
        (BVH.replace("Frames: 3", "Frames: 4"), "3 rows of motion for 4 frames"),
        (BVH.replace("Frames: 3", "Frames: 0"), "0 frames"),
        (BVH.replace("0 100 290", "0 nan 290"), "must be finite"),
        (BVH.replace("0.1", "0"), "not a motion|division"),
        (BVH.replace("0.1", "10"), "1 to 1000 Hz"),
        (BVH[:200], "not a motion"),
        (BVH.replace("OFFSET 0 50 0", "OFFSET 0"), "not a motion"),
        (BVH.replace("Zrotation Xrotation", "Wrotation Xrotation"), "not a motion"),
        (BVH.replace("OFFSET 0 50 0", "OFFSET 0 x 0"), "not a motion"),
    ],
)
def test_a_broken_file_is_one_line(tmp_path, text, reason):
    file = tmp_path / "broken.bvh"
    file.write_text(text)
    with pytest.raises(SceneError, match=reason):
        read_motion(str(file), scale=0.01)


def test_an_archive_that_is_none_or_far_too_large_is_one_line(tmp_path, monkeypatch):
    file = tmp_path / "walk.npz"
    file.write_bytes(b"PK but no zip")
    with pytest.raises(SceneError, match="not a motion"):
        read_motion(str(file))
    np.savez_compressed(file, position_m=np.zeros((9, 2, 3)), parent=[-1, 0], frame_rate_hz="x")
    with pytest.raises(SceneError, match="not a motion"):
        read_motion(str(file))
    monkeypatch.setattr("x2radar.sim.bodies.motion.recorded.MOST_BYTES", 100)
    with pytest.raises(SceneError, match="more than 0 MiB"):
        read_motion(str(file))


def test_too_small_a_scale_is_said(walk):
    with pytest.raises(SceneError, match="is the scale right"):
        read_motion(str(walk), scale=1e-5)
    with pytest.raises(SceneError, match="cannot read the motion"):
        read_motion(str(walk) + ".missing")


def test_a_scene_plays_it(walk):
    scene = parse_scene(
        f"steps: [{{body: motion, duration_s: 2, file: {walk}, scale: 0.01, label: pet,"
        " place_m: [0.5, 5.0]}]",
        "mine",
        "mine.yaml",
    )
    (actor,) = scene.steps[0].actors
    mover = actor.make(np.random.default_rng(0))
    assert mover.label == "pet"
    points = mover.at(np.array([0.0, 0.1]), np.array([0.0, 0.0, 1.0]))
    assert points.rcs_m2.shape == (2, len(mover.names))
    assert points.position_m[0, 0] == pytest.approx([0.5, 2.0, 1.25], abs=0.3)


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ("", "file: is missing"),
        ("file: none.bvh", "cannot read the motion"),
        ("file: 3", "file: must be"),
    ],
)
def test_a_scene_without_its_file_says_so(keys, reason):
    with pytest.raises(SceneError, match=reason):
        parse_scene(f"steps: [{{body: motion, duration_s: 2, {keys}}}]", "mine", "mine.yaml")
