"""`radard why`: the decision of a replay, in words and pictures, and what moved it."""

from dataclasses import replace

import numpy as np
import pytest
from onnx import TensorProto, helper, numpy_helper

from radard.cli import main as radard_main
from radard.commands.why import lines, place
from radard.config.config import Config
from radard.judge.bundle import ModelInput, load_bundle
from radard.judge.occlusion import effects, map_views, occluded
from radard.run.replays import moment_of
from tests.radar_helpers import run_radard
from tests.recording_helpers import record_scene, run
from x2train.bundle.writing import write_bundle


@pytest.fixture(scope="module")
def person(tmp_path_factory):
    return record_scene(tmp_path_factory.mktemp("why") / "person.h5", "human", n=270)


def why(capsys, *argv):
    return run(capsys, "why", *argv, main=radard_main)


CORNER = np.zeros((101, 40), np.float32)
CORNER[40:60, 30:40] = 0.02


@pytest.fixture
def linear(tmp_path):
    """A bundle that looks at one corner of one map; what is there speaks for a person."""
    weights, value = np.zeros((101 * 40, 2), np.float32), helper.make_tensor_value_info
    weights[:, 0] = CORNER.ravel()
    nodes = [
        helper.make_node("Flatten", ["maps"], ["flat"]),
        helper.make_node("Gemm", ["flat", "w", "b"], ["logits"]),
    ]
    given = [value("maps", TensorProto.FLOAT, ["n", 101, 40])]
    made = [value("logits", TensorProto.FLOAT, ["n", 2])]
    known = {"w": weights, "b": np.array([-1.0, 0.0], np.float32)}
    tensors = [numpy_helper.from_array(values, name) for name, values in known.items()]
    graph = helper.make_graph(nodes, "linear", given, made, tensors)
    opset = [helper.make_opsetid("", 17)]
    bundle = replace(
        load_bundle("fast"),
        name="linear",
        onnx=helper.make_model(graph, opset_imports=opset, ir_version=9).SerializeToString(),
        inputs=(ModelInput("maps", (101, 40), "velocity_time"),),
        classes=("human", "pet"),
        temperature=1.0,
        pet_limit=0.5,
        policy="window",
        evidence={},
        n_hidden=0,
    )
    training = {"recipe": "by hand", "command": "none"}
    write_bundle(tmp_path, bundle, training=training, metrics={}, gate={})
    return tmp_path / "linear.onnx"


def test_it_says_what_a_replay_decided(person, capsys):
    code, out, err = why(capsys, person, "--at", "3.3")
    assert (code, err) == (0, "")
    _, records, _ = run_radard("--port", f"replay:{person}", "-o", "json")
    decision = next(r for r in records if r["type"] == "decision" and r["t_s"] == 3.45)
    assert f"window that ends at 3.45 s: A {'person' if decision['alarm'] else 'pet'}" in out
    assert f"{decision['p_human']:7.3f}" in out
    assert f"{decision['fused_p_human']:8.3f}" in out
    for stage in ("frames", "gate", "classifier", "rule", "* decided"):
        assert stage in out


def test_parts_of_a_linear_network_are_what_its_weights_say(person, linear):
    moment = moment_of(person, 3.4, Config(model={"name": str(linear)}))
    assert moment.seen is not None
    values = moment.seen.features["velocity_time"]
    parts = occluded(moment.classifier, moment.settings, moment.seen, 0.5)
    assert len(parts) == 8 * 5
    (view,) = map_views(moment.settings, moment.seen)
    for part in parts:
        inside = (CORNER * values)[part.rows, part.columns].sum()
        assert part.effect == pytest.approx(inside, abs=1e-4)
    assert [abs(p.effect) for p in parts] == sorted((abs(p.effect) for p in parts), reverse=True)
    drawn = effects(parts, view)
    assert drawn[50, 35] > 0
    assert drawn[5, 5] == 0
    assert "velocity_time, " in place(parts[0])
    assert "m/s" in place(parts[0])
    assert "for a person" in "\n".join(lines(moment, parts))


def test_axes_are_those_of_the_maps(person, capsys, tmp_path):
    moment = moment_of(person, 3.4, Config(model={"name": "fast"}))
    views = {view.name: view for view in map_views(moment.settings, moment.seen)}
    assert list(views) == ["velocity_time", "range_time", "velocity_time_medium", *list(views)[3:]]
    v = views["velocity_time"]
    assert (v.rows[0], v.rows[50], v.rows[-1]) == pytest.approx((-5.0, 0.0, 5.0))
    assert (v.columns[0], v.columns[-1]) == pytest.approx((-1.95, 0.0))
    # A picture of all of them, the network's memory included.
    out = tmp_path / "why.svg"
    code, _, err = why(capsys, person, "--at", "3.4", "--model", "fast", "--out", out)
    assert (code, err.strip()) == (0, str(out))
    assert b"velocity_time_long" in out.read_bytes()


def test_the_thesis_network_has_a_profile_and_a_diagram(person, capsys, tmp_path):
    out_file = tmp_path / "why.png"
    code, out, _ = why(capsys, person, "--at", "3.4", "--model", "thesis", "--out", out_file)
    assert code == 0
    assert "cadence-velocity, " in out
    assert out_file.read_bytes().startswith(b"\x89PNG")
    moment = moment_of(person, 3.4, Config(model={"name": "thesis"}))
    profile, diagram = map_views(moment.settings, moment.seen)
    assert (profile.name, diagram.name) == ("range profile", "cadence-velocity")
    vector = moment.seen.features["thesis_type2"]
    assert np.array_equal(profile.of(vector)[0], vector[:392])
    assert np.array_equal(diagram.of(vector)[:, 0], vector[392 : 392 + 28])


@pytest.mark.parametrize(
    ("argv", "code", "said"),
    [
        (["--at", "99"], 2, "has decisions from 2.45 to 4.45 s"),
        (["--at", "-1"], 2, "--at -1: must be 0 to"),
        (["--at", "3", "--out", "a.bmp"], 2, "must end in .png, .pdf, .svg"),
        (["--at", "3", "--out", "gone/a.png", "--model", "none"], 1, "gone/a.png: cannot write"),
    ],
)
def test_what_cannot_be_said_is_one_line(person, capsys, argv, code, said):
    ended, out, err = why(capsys, person, *argv)
    assert (ended, err.count("\n")) == (code, 1)
    assert said in err
    assert ("No network was asked" in out) is ("none" in argv)
    assert why(capsys, "gone.h5", *argv)[0] in {2, 66}
