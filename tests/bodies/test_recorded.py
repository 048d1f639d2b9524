"""Recorded motion: a small BVH file of our own, archives, standard skeletons, broken files."""

import numpy as np
import pytest

from tests.body_helpers import ANTENNA_M, drawn
from x2radar.errors import SceneError
from x2radar.sim.bodies.motion import recorded
from x2radar.sim.bodies.motion.recorded import draw_recorded, read_motion
from x2radar.sim.bodies.skeleton.skeleton import PERSON, QUADRUPED
from x2radar.sim.bodies.skins import SKINS
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
    assert motion.skeleton.names == ("Chest", "Arm", "Arm end")
    assert motion.frame_rate_hz == pytest.approx(10.0)
    hips, chest, arm, hand = (motion.position_m[:, k] for k in range(4))
    # The file's (x, y up, z) is the room's (x, -z, up).
    assert hips == pytest.approx(np.array([[0, -3, 1], [0, -2.9, 1], [0, -2.8, 1]]))
    assert chest[:, 2] == pytest.approx([1.5, 1.5, 1.5])
    assert hand[0] - arm[0] == pytest.approx([0.4, 0, 0])
    assert hand[1] - arm[1] == pytest.approx([0, 0, 0.4])  # a turn of 90 degrees about z lifts it
    assert hand[2] - arm[2] == pytest.approx([0, 0.4, 0])  # about the vertical: towards -z
    assert motion.half_m[:, 0] == pytest.approx([0.25, 0.05, 0.2])


def test_the_velocity_between_frames_does_not_jump(tmp_path):
    # A joint that swings twice a second, recorded at 30 Hz.
    t_s = np.arange(90) / 30
    position_m = np.zeros((90, 2, 3))
    position_m[:, 1] = np.stack([np.sin(4 * np.pi * t_s), 0 * t_s, 0.5 + 0 * t_s], axis=1)
    file = tmp_path / "swing.npz"
    np.savez(file, position_m=position_m, parent=[-1, 0], frame_rate_hz=30.0)
    motion = read_motion(str(file), up="z")
    fine_s = np.arange(0.5, 2.5, 1e-3)
    x = 2 * motion(fine_s).centre_m[:, 0, 0]
    assert x == pytest.approx(np.sin(4 * np.pi * fine_s), abs=0.01)
    # 158 m/s2 at most; straight lines between the frames would jump by 5 m/s.
    assert np.abs(np.diff(x, n=2)).max() / 1e-3**2 < 250
    assert motion(t_s).centre_m[:, 0] == pytest.approx(position_m.mean(axis=1), abs=1e-12)


def standard(skeleton, n=40):
    """Positions of a skeleton's standard joints: somebody who rocks to and fro."""
    names = sorted({name for part in skeleton.parts for name in part.joints})
    place_m = np.random.default_rng(0).uniform(-0.3, 0.3, (len(names), 3))
    place_m[:, 2] += 0.7
    at = {name: k for k, name in enumerate(names)}
    top, floor = ("head_top", "l_toe") if skeleton is PERSON else ("HL_hip", "HL_paw")
    place_m[at[top], 2], place_m[at[floor], 2] = (1.7, 0.0) if skeleton is PERSON else (0.5, 0.0)
    rock = 0.1 * np.sin(np.arange(n) / 5)
    return names, place_m + rock[:, None, None] * np.array([1.0, 0.0, 0.0])


@pytest.mark.parametrize("skin", SKINS)
@pytest.mark.parametrize(("skeleton", "label"), [(PERSON, "human"), (QUADRUPED, "pet")])
def test_standard_joints_move_the_parts_of_a_kind_with_its_girths(tmp_path, skeleton, label, skin):
    names, position_m = standard(skeleton)
    file = tmp_path / "clip.npz"
    parent = [-1, *range(len(names) - 1)]
    np.savez(file, position_m=position_m, parent=parent, frame_rate_hz=30.0, names=names)
    how = {"file": str(file), "up": "z", "label": label, "skin": skin, "place_m": (0, 3)}
    body = draw_recorded(np.random.default_rng(0), **how)
    motion = read_motion(str(file), up="z")
    assert motion.skeleton is skeleton
    size_m = 1.7 if skeleton is PERSON else 0.5
    girth = np.array([part.half_girth for part in skeleton.parts])
    assert motion.half_m[:, 1:] == pytest.approx(size_m * girth, rel=0.02)
    pose = motion(np.array([0.5]))
    at = dict(zip(names, position_m[15], strict=True))
    for k, part in enumerate(skeleton.parts):
        begin, end = (at[name] for name in part.joints)
        assert pose.centre_m[0, k] == pytest.approx(0.5 * (begin + end), abs=1e-6)
    # Sides are square to the parts and to the body's left.
    right, left = (at[name] for name in skeleton.left)
    assert (pose.side * pose.axis).sum(axis=-1) == pytest.approx(0.0, abs=1e-9)
    assert (pose.side[0, 0] * (left - right)).sum() > 0
    points = body.at(np.linspace(0, 1, 9), ANTENNA_M)
    generated = drawn("human" if skeleton is PERSON else "dog", "walk", 0, skin=skin)
    if skin != "points":
        assert body.names == generated.names
    assert np.isfinite(points.position_m).all()
    assert points.rcs_m2.shape == (9, len(body.names))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "cut short|no line MOTION"),
        (BVH.replace("MOTION", "NOTION"), "'NOTION' is no word"),
        (BVH.replace("Frames: 3", "Frames: 4"), "3 rows of motion for 4 frames"),
        (BVH.replace("0 100 290", "0 nan 290"), "must be finite"),
        (BVH.replace("0.1", "0"), "not a motion|division"),
        (BVH.replace("0.1", "10"), "1 to 1000 Hz"),
        *(
            (BVH.replace(word, bad), "not a motion")
            for word, bad in (("OFFSET 0 50 0", "OFFSET 0"), ("Zrot", "Wrot"), (BVH[200:], ""))
        ),
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
    monkeypatch.setattr(recorded, "MAX_BYTES", 100)
    with pytest.raises(SceneError, match="more than 0 MiB"):
        read_motion(str(file))


@pytest.mark.parametrize("scale", [1e-5, 10.0])
def test_a_scale_that_makes_no_body_is_said(walk, scale):
    with pytest.raises(SceneError, match="is the scale right"):
        read_motion(str(walk), scale=scale)


def test_a_scene_plays_it(walk):
    scene = parse_scene(
        f"steps: [{{body: motion, duration_s: 2, file: {walk}, scale: 0.01, label: pet,"
        " place_m: [0.5, 5.0], turn_deg: 90, start_s: 1}]",
        "mine",
        "mine.yaml",
    )
    (actor,) = scene.steps[0][0].actors
    mover = actor.make(np.random.default_rng(0))
    assert mover.label == "pet"
    points = mover.at(np.array([0.0, 1.1]), np.array([0.0, 0.0, 1.0]))
    assert points.rcs_m2.shape == (2, len(mover.names))
    # The file's (0, -3) turned to the left about its origin.
    assert points.position_m[0, 0] == pytest.approx([3.5, 5.0, 1.25], abs=0.3)
    assert points.position_m[1, 0] == pytest.approx([3.4, 5.0, 1.25], abs=0.3)
