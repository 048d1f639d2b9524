"""Files of other programs become clips: BVH, ASF with AMC, glTF, archives."""

import base64
import json

import numpy as np
import pytest
import yaml

from tests.training.motion_helpers import stander, walker
from x2radar.errors import SceneError
from x2train.cli import main
from x2train.motion.clips import KINDS, JointMap, read_clip, read_map, standard_clip
from x2train.motion.formats import read_motions

ASF = (
    """\
# a root with one bone that points up and another that goes on from it
:version 1.10
:name probe
:units
  mass 1.0
  length 1.0
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
"""
    + "".join(
        f"  begin\n    id {k}\n    name {name}\n    direction 0 1 0\n    length {length}\n"
        f"    axis 0 0 {turn} XYZ\n    dof {dof}\n{limits}  end\n"
        for k, name, length, turn, dof, limits in (
            (1, "lower", 2, 0, "rz", "    limits (-180 180)\n"),
            (2, "upper", 3, 90, "rx", ""),
        )
    )
    + ":hierarchy\n  begin\n    root lower\n    lower upper\n  end\n"
)
AMC = "#!OML:ASF probe.asf\n:FULLY-SPECIFIED\n:DEGREES\n" + "".join(
    f"{k}\nroot 1 0 0 0 0 {root}\nlower {lower}\nupper {upper}\n"
    for k, root, lower, upper in ((1, 0, 0, 0), (2, 0, 90, 0), (3, 90, 0, 90))
)


def gltf(times, turns):
    """Return a glTF of an arm (0, 2, 0) long whose shoulder turns."""
    data = np.array(times, "<f4").tobytes() + np.array(turns, "<f4").tobytes()
    n = len(times)
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    channel = {"sampler": 0, "target": {"node": 1, "path": "rotation"}}
    curve = {"input": 0, "output": 1, "interpolation": "LINEAR"}
    times_at, turns_at = ({"buffer": 0, "byteOffset": at} for at in (0, 4 * n))
    shoulder = {"name": "shoulder", "translation": [1, 0, 0], "children": [0]}
    made = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": len(data), "uri": uri}]}
    made["nodes"] = [{"name": "hand", "translation": [0, 2, 0]}, shoulder]
    views = {**times_at, "byteLength": 4 * n}, {**turns_at, "byteLength": 16 * n}
    kinds = {"bufferView": 0, "type": "SCALAR"}, {"bufferView": 1, "type": "VEC4"}
    made["bufferViews"] = list(views)
    made["accessors"] = [{"componentType": 5126, "count": n, **kind} for kind in kinds]
    return made | {"animations": [{"name": "wave", "channels": [channel], "samplers": [curve]}]}


def test_acclaim_bones_turn_about_their_own_axes(tmp_path):
    (tmp_path / "probe.asf").write_text(ASF)
    (tmp_path / "probe.amc").write_text(AMC)
    (motion,) = read_motions(tmp_path / "probe.amc", rate_hz=120.0)
    assert motion.joints == ("root", "lower", "upper")
    assert motion.frame_rate_hz == 120.0
    np.testing.assert_allclose(motion.position[0], [[1, 0, 0], [1, 2, 0], [1, 5, 0]], atol=1e-9)
    # The lower bone falls to the left, and takes the upper one along.
    np.testing.assert_allclose(motion.position[1], [[1, 0, 0], [-1, 0, 0], [-4, 0, 0]], atol=1e-9)
    # Its own x axis is the room's y where it is made, along the bone: nothing moves by that.
    np.testing.assert_allclose(motion.position[2], [[1, 0, 0], [-1, 0, 0], [-4, 0, 0]], atol=1e-9)


def test_gltf_curves_are_sampled_between_their_keys(tmp_path):
    half = np.sqrt(0.5)
    text = json.dumps(gltf([0.0, 1.0], [[0, 0, 0, 1], [0, 0, half, half]]))
    (tmp_path / "a.gltf").write_text(text)
    (motion,) = read_motions(tmp_path / "a.gltf")
    assert motion.name == "a_wave"
    assert motion.joints == ("shoulder", "hand")
    assert len(motion.position) == 61
    np.testing.assert_allclose(motion.position[0, 1], [1, 2, 0], atol=1e-6)
    np.testing.assert_allclose(motion.position[60, 1], [-1, 0, 0], atol=1e-6)
    # Half way it is turned by 45 degrees, not half the way through the middle.
    np.testing.assert_allclose(motion.position[30, 1], [1 - 2 * half, 2 * half, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.bvh", "HIERARCHY\nROOT base\n{\n"),
        ("a.amc", AMC),
        ("a.gltf", "{"),
        ("a.gltf", '{"asset": {"version": "2.0"}, "animations": [{"channels": [{}]}]}'),
        ("a.gltf", json.dumps(gltf([0.0], [[0, 0, 0, 1]])).replace('count": 1', 'count": 99999')),
        ("a.npz", "no archive"),
        ("a.fbx", "unknown"),
    ],
)
def test_what_cannot_be_read_is_one_line(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(SceneError) as caught:
        read_motions(tmp_path / name)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def write_map(path, **changed):
    whole = {"kind": "person", "scale": 0.01, "up": "z"}
    whole["joints"] = {n: f"rig:{n}" for n in KINDS["person"]}
    path.write_text(yaml.safe_dump(whole | changed))
    return path


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"kind": "bird"}, "kind: input should be 'person' or 'quadruped'"),
        ({"joints": {"pelvis": "hips"}}, "not given: chest"),
        ({"joints": {"wing": "x", **{n: n for n in KINDS["person"]}}}, "no standard joint: wing"),
        ({"scale": 0}, "scale: input should be greater than 0"),
        ({"colour": "red"}, "colour: unknown key"),
    ],
)
def test_maps_are_whole(tmp_path, changed, words):
    with pytest.raises(SceneError, match=words):
        read_map(write_map(tmp_path / "map.yaml", **changed))


def write_rig(path, joint_m, kind, rate_hz):
    """Write joints in centimetres, z up, a metre over the floor, by names of another program."""
    made = {"positions": 100 * joint_m + [0, 0, 100], "frame_rate_hz": rate_hz}
    parents = range(-1, len(KINDS[kind]) - 1)
    np.savez(path, **made, joints=[f"rig:{n}" for n in KINDS[kind]], parents=parents)
    return path


def import_anna(tmp_path, *words):
    more = ["--map", str(write_map(tmp_path / "map.yaml")), "--out", str(tmp_path / "clips")]
    return main(["motion", "import", *words, "--species", "human", "--who", "anna", *more])


def test_a_rig_in_centimetres_at_another_rate_becomes_the_walk_it_was(tmp_path):
    write_rig(tmp_path / "a.npz", walker()[::2], "person", 30.0)
    assert import_anna(tmp_path, str(tmp_path / "a.npz"), "--licence", "CC0") == 0
    clip = read_clip(tmp_path / "clips/anna_a.npz")
    assert (clip.individual, clip.label, clip.licence) == ("anna", "human", "CC0")
    assert clip.frame_rate_hz == 60.0
    assert clip.step_m.mean() * 60 == pytest.approx(1.2, rel=0.03)
    assert clip.size_m == pytest.approx(1.77, abs=0.01)  # soles on the floor
    assert clip.joint_m[..., 2].min() == pytest.approx(0.0, abs=0.01)


def test_no_clip_takes_the_place_of_another(tmp_path, capsys):
    """Two files of one name in two folders were one clip, and nobody said so."""
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_rig(tmp_path / name / "walk.npz", walker()[::2], "person", 30.0)
    first, other = (str(tmp_path / name / "walk.npz") for name in ("a", "b"))
    assert import_anna(tmp_path, first, other) == 2
    assert "anna_walk.npz is there already" in capsys.readouterr().err
    assert not (tmp_path / "clips").exists()
    assert [import_anna(tmp_path, path) for path in (first, other)] == [0, 2]


def test_a_map_of_another_body_or_of_joints_that_are_not_there_is_refused(tmp_path, capsys):
    path = write_rig(tmp_path / "a.npz", stander(), "quadruped", 60.0)
    words = ["motion", "import", str(path), "--species", "dog", "--who", "rex"]
    made = write_map(tmp_path / "map.yaml")
    assert main([*words, "--map", str(made), "--out", str(tmp_path / "c")]) == 2
    assert "the map is of kind person" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()
    (motion,) = read_motions(path)
    with pytest.raises(SceneError, match=r"no joint paw; it has rig:pelvis"):
        standard_clip(motion, JointMap("quadruped", dict.fromkeys(KINDS["quadruped"], "paw")), "a")
