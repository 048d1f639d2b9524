"""Finetuning: own clips quieten a pet, the guard holds, and what does not fit is refused."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest

from radard.classify.bundle import CLASSES, load_bundle
from radard.classify.classifier import Classifier
from radard.errors import UsageError
from radard.web.labels import LabelFile
from tests.alarm_helpers import write_recording
from tests.radar_helpers import noise, run_radard
from tests.training_helpers import (
    MAPS,
    give_head,
    settings,
    toy,
    trained,
    write_tiny,
)
from x2radar.errors import RecordingError
from x2train.cli import main
from x2train.finetune.guard import Guard, Misses, alarms_of, load_guard
from x2train.finetune.labels import OwnClip, labelled_clips, merged, named_clips
from x2train.finetune.verifier import fit_head
from x2train.finetune.windows import judge_of, own_windows
from x2train.generate.shards import ShardSet
from x2train.nets.bundle_answers import Answers, outputs_of
from x2train.nets.bundle_graph import MOST_NATS, N_KEPT, Head, recent_scores, with_verifier
from x2train.nets.graph_net import GraphNet

ULID = "01J0000000000000000000000"


def windows(folder, n, seed):
    about = {"kind": "windows", "use": "held out", "seed": seed, "settings": settings()}
    ShardSet(folder, about).write("shard-00000", toy(n, seed=seed))
    return folder


@pytest.fixture(scope="module", params=["summed", "temporal"])
def made(request, tmp_path_factory):
    """Return a folder: a bundle that takes all for people, guards, and clips of a dog."""
    folder = tmp_path_factory.mktemp("finetune")
    network = replace(trained()[0], temperature=12.0)
    write_tiny(folder, network)
    if request.param == "temporal":
        give_head(folder / "tiny.onnx", temperature=2.5)
    windows(folder / "guard", 1536, 5)
    windows(folder / "mix", 384, 6)
    for seed in (1, 2, 3):
        port = f"sim:dog_trot?seed={seed}"
        argv = ("--port", port, "--model", "none", "--speed", "max", "--duration", "8")
        record = ("--record", str(folder / f"dog{seed}.h5"), "-o", "null")
        assert run_radard(*argv, *record)[0] == 0
    return folder


@pytest.fixture(scope="module")
def bundle(made):
    return load_bundle(str(made / "tiny.onnx"))


def finetune(made, *argv, model="tiny"):
    sets = ("--guard", str(made / "guard"), "--model", str(made / f"{model}.onnx"))
    return main(["finetune", *argv, *sets])


def dogs(made, label="pet"):
    return [f"{made / name}.h5={label}" for name in ("dog1", "dog2", "dog3")]


def test_who_names_no_bundle_begins_with_the_one_that_judged_the_clips(made, tmp_path, capsys):
    path = tmp_path / "x4.h5"
    argv = ("--port", "sim:dog_trot?device=x4m03", "--model", "none", "--speed", "max")
    assert run_radard(*argv, "--duration", "4", "--record", str(path), "-o", "null")[0] == 0
    assert judge_of([OwnClip(path, "pet")]) == "x4m03"
    assert judge_of([OwnClip(made / "dog1.h5", "pet")]) == "accurate"
    assert judge_of([]) == "accurate"
    guard = ("--guard", str(made / "guard"))
    assert main(["finetune", f"{path}=pet", *guard, "--name", "x4m03"]) == 2
    assert "a name of its own" in capsys.readouterr().err


@pytest.mark.parametrize("way", ["verifier", "full"])
def test_own_clips_become_quiet_and_radard_runs_the_bundle(made, tmp_path, way, capsys):
    out = ("--out", str(tmp_path), "--mix", str(made / "mix"), "--epochs", "20")
    clips = [(str(k), "pet", str(made / f"dog{k}.h5"), "alarm") for k in (1, 2, 3)]
    gone = ("4", "pet", str(made / "gone.h5"), "alarm")
    labels = ["--labels", str(label_file(tmp_path, *clips, gone))]
    assert finetune(made, *(labels if way == "verifier" else dogs(made)), f"--{way}", *out) == 0
    said = capsys.readouterr().out
    assert "wrote" in said
    assert (f"left out: {ULID}4: its clip is gone" in said) is (way == "verifier")
    sidecar = json.loads((tmp_path / "own.json").read_text())
    base = json.loads((made / "tiny.json").read_text())
    same = ("schema", "inputs", "features", "stream", "classes", "temperature", "pet_limit")
    assert {k: sidecar[k] for k in same} == {k: base[k] for k in same}
    more = N_KEPT if way == "verifier" else 0
    assert sidecar.get("hidden") == (base["hidden"] + more if "hidden" in base else None)
    assert sidecar["evidence"] == base["evidence"]
    about = sidecar["training"]["finetuned"]
    assert (about["way"], about["base_onnx_sha256"]) == (way, base["onnx_sha256"])
    assert [clip["file"] for clip in about["own"]] == ["dog1.h5", "dog2.h5", "dog3.h5"]
    # Where somebody keeps recordings is nobody's business.
    assert str(made / "dog1") not in (tmp_path / "own.json").read_text()
    metrics = sidecar["metrics"]
    assert metrics["own clips of pets with an alarm, before"] == 3
    assert metrics["own clips of pets with an alarm, after"] == 0
    for what in ("windows", "passages", "fused"):
        rise = metrics[f"people missed, {what}, after"] - metrics[f"people missed, {what}, before"]
        assert rise <= 0.0015
    assert "own clips of pets with an alarm | 3 of 3" in (tmp_path / "own.md").read_text()
    port = f"replay:{made / 'dog1.h5'}"
    for model, has_alarm in ((made / "tiny.onnx", True), (tmp_path / "own.onnx", False)):
        code, records, _ = run_radard("--port", port, "--model", str(model), "-o", "json")
        assert code == 0
        assert any(r.get("alarm") for r in records if r["type"] == "decision") is has_alarm


def test_a_verifier_only_turns_people_into_pets(bundle):
    rng = np.random.default_rng(0)
    windows = toy(96, seed=7)
    given = {name: windows[name] for name in MAPS}
    is_first = np.arange(96) % 6 == 0
    plain, seen = outputs_of(bundle.onnx, given, is_first=is_first, with_what_is_seen=True)
    weight = rng.standard_normal(seen.shape[1]) / np.sqrt(seen.shape[1])
    score = seen @ weight
    recent = recent_scores(score, is_first)
    head = Head(weight, 0.0, float(np.median(score)), float(np.median(recent)))
    with_it = with_verifier(bundle.onnx, head, pet=1, temperature=bundle.temperature)
    made, _ = outputs_of(with_it, given, is_first=is_first)
    turns = head.excess(head.score(seen)), head.fused_excess(recent)
    expected = plain.turned(*turns, pet=1, temperature=bundle.temperature)
    assert (plain.fused is None) is (bundle.n_hidden == 0)
    pairs = [(plain.logits, made.logits, expected.logits, turns[0], bundle.temperature)]
    if plain.fused is not None:
        pairs.append((plain.fused, made.fused, expected.fused, turns[1], 1.0))
    for before, found, wanted, excess, temperature in pairs:
        assert 0 < (excess > 0).sum() < len(excess)
        # Unsure: bit by bit what the network says.
        assert (found[excess == 0] == before[excess == 0]).all()
        np.testing.assert_allclose(found, wanted, atol=2e-3 * temperature)
        assert (found[:, [0, 2]] == before[:, [0, 2]]).all()
        assert ((found - before)[:, 1] <= (MOST_NATS + 1e-3) * temperature).all()
    p = [x.p(bundle.temperature)[:, 0] for x in (plain, made)]
    assert (p[1] <= p[0] + 1e-12).all()
    with pytest.raises(UsageError, match="has a verifier already"):
        outputs_of(with_it, given, with_what_is_seen=True)
    n_hidden = bundle.n_hidden + N_KEPT if bundle.n_hidden else 0
    longer = replace(bundle, onnx=with_it, n_hidden=n_hidden)
    assert Classifier(longer).bundle.sha256 != bundle.sha256


def test_without_a_fused_threshold_the_temporal_head_is_as_it_was(bundle):
    windows = toy(24, seed=9)
    given = {name: windows[name] for name in MAPS}
    is_first = np.arange(24) % 4 == 0
    plain, seen = outputs_of(bundle.onnx, given, is_first=is_first, with_what_is_seen=True)
    head = Head(np.ones(seen.shape[1]), 0.0, -1e6)
    with_it = with_verifier(bundle.onnx, head, pet=1, temperature=bundle.temperature)
    made, _ = outputs_of(with_it, given, is_first=is_first)
    np.testing.assert_array_equal(made.fused, plain.fused)
    assert (made.logits[:, 1] > plain.logits[:, 1]).all()


def test_recent_scores_begin_anew_with_the_gate_and_forget():
    score = np.array([2.0, 4.0, 6.0, -10.0, 1.0, 8.0])
    is_first = np.array([True, False, False, True, False, False])
    np.testing.assert_allclose(recent_scores(score, is_first), [2, 3, 4, -10, -4.5, -1 / 3])
    # Somebody comes after an hour of the pet: four windows later little of it is left.
    long = np.r_[np.full(3600, 5.0), np.full(4, -5.0)]
    assert recent_scores(long, np.arange(3604) == 0)[-1] < -1


def test_a_graph_is_trained_as_onnxruntime_runs_it(bundle):
    windows = toy(24, seed=8)
    given = {name: windows[name] for name in MAPS}
    net = GraphNet(bundle.onnx)
    is_first = np.arange(24) % 4 == 0
    again, first = (
        outputs_of(x, given, is_first=is_first)[0] for x in (net.to_onnx(), bundle.onnx)
    )
    np.testing.assert_array_equal(again.logits, first.logits)
    np.testing.assert_array_equal(again.fused, first.fused)
    model = onnx.load_from_string(bundle.onnx)
    model.graph.node[0].op_type = "Cos"
    with pytest.raises(UsageError, match="has Cos, which cannot be trained"):
        GraphNet(model.SerializeToString())


@pytest.mark.parametrize("policy", ["fused", "window"])
def test_misses_count_people_alone_by_the_policy(bundle, policy):
    bundle = replace(bundle, policy=policy)
    guard = Guard(toy(96), ({},))
    sure = np.zeros((96, 3))
    # Everybody is a pet: all people are missed; everybody is a person: none is.
    for column, missed in ((1, True), (0, False)):
        sure[:] = 0
        sure[:, column] = 10 * bundle.temperature
        fused = sure / bundle.temperature if bundle.n_hidden else None
        found = guard.misses(bundle, Answers(sure, fused))
        n_windows = int((guard.label == 0).sum())
        assert (found.n_windows, found.n_passages) == (n_windows, n_windows // 4)
        assert found.windows == missed * n_windows
        assert found.passages == missed * n_windows // 4
    people = guard.of_people()
    assert set(people.label) == {CLASSES.index("human")}
    one, other = guard.halves()
    assert len(one.label) + len(other.label) == 96
    assert not set(one.columns["passage"]) & set(other.columns["passage"])


@pytest.mark.parametrize(
    ("windows_more", "passages_more", "is_allowed"),
    [(0, 0, True), (1, 0, True), (2, 0, False), (0, 1, False), (-5, -1, True)],
)
def test_the_bound_is_on_windows_and_on_passages(windows_more, passages_more, is_allowed):
    before = Misses(100, 1000, 10, 250, 80)
    after = Misses(100 + windows_more, 1000, 10 + passages_more, 250, 80)
    assert before.allows(after) is is_allowed
    fused = Misses(100, 1000, 10 + passages_more, 250, 80 + windows_more)
    assert before.allows(fused) is is_allowed


def test_who_leaves_while_the_alarm_waits_is_an_alarm(bundle):
    log_p = np.log([[0.5, 0.3, 0.2]])
    unsure = Answers(bundle.temperature * log_p, log_p if bundle.n_hidden else None)
    alarms = list(alarms_of(bundle, unsure, np.array([True]), np.array([3.0])))
    assert alarms == [True]
    twice = Answers(
        *(None if x is None else np.repeat(x, 2, 0) for x in (unsure.logits, unsure.fused))
    )
    alarms = list(alarms_of(bundle, twice, np.array([True, True]), np.array([3.0, 30.0])))
    assert alarms == [True, True]


def test_a_head_learns_what_a_glance_tells_apart():
    rng = np.random.default_rng(1)
    own, people = rng.standard_normal((40, 50)), rng.standard_normal((400, 50))
    own[:, 3] += 4
    head = fit_head(np.float32(own), np.float32(people), np.zeros((0, 50), np.float32))
    scores = head.score(np.float32(own)), head.score(np.float32(people))
    assert np.mean(scores[0] > np.quantile(scores[1], 0.998)) > 0.5
    again = fit_head(np.float32(own), np.float32(people), np.zeros((0, 50), np.float32))
    assert (again.weight == head.weight).all()


def label_file(tmp_path, *lines):
    file = LabelFile(tmp_path / "labels.jsonl")
    for event, label, clip, kind in lines:
        file.add({"event": ULID + event, "label": label, "clip": clip, "kind": kind})
    return file.path


def test_labels_of_the_dashboard_point_to_clips(made, tmp_path):
    first, second = str(made / "dog1.h5"), str(made / "dog2.h5")
    path = label_file(
        tmp_path,
        ("A", "human", first, "alarm"),
        ("A", "pet", first, "alarm"),
        ("B", "wrong", second, "alarm"),
        ("C", "pet", str(made / "gone.h5"), "alarm"),
        ("D", "wrong", None, "tamper"),
        ("E", "other", None, "alarm"),
    )
    found = labelled_clips(path)
    assert [(c.path.name, c.label) for c in found.clips] == [
        ("dog1.h5", "pet"),
        ("dog2.h5", "wrong"),
    ]
    said = "; ".join(found.left_out)
    assert "its clip is gone" in said
    assert "not an alarm" in said
    assert "no clip was kept" in said
    moved = labelled_clips(path, made)
    assert [c.path for c in moved.clips] == [made / "dog1.h5", made / "dog2.h5"]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("{", ":2: no label of the dashboard"),
        ('{"format": "radard-label", "format_version": 9}', "format_version 9"),
        ('{"format": "radard-label", "format_version": 1, "event": "x"}', ":2: lacks an event"),
    ],
)
def test_lines_that_are_no_labels_are_refused(made, tmp_path, line, words):
    path = label_file(tmp_path, ("A", "pet", str(made / "dog1.h5"), "alarm"))
    path.write_text(path.read_text() + line + "\n")
    with pytest.raises(UsageError, match=words):
        labelled_clips(path)


def test_clips_are_named_once_with_one_label(made):
    path = made / "dog1.h5"
    assert merged([OwnClip(path, "pet"), OwnClip(path, "pet")]) == (OwnClip(path, "pet"),)
    with pytest.raises(UsageError, match="labelled both pet and human"):
        merged([OwnClip(path, "pet"), OwnClip(path, "human")])
    with pytest.raises(UsageError, match="nothing to quieten"):
        merged([OwnClip(path, "human")])
    for text in ("dog1.h5", "=pet", f"{path}=dog"):
        with pytest.raises(UsageError, match="FILE=LABEL is wanted"):
            named_clips([text])


def test_a_recording_in_which_nothing_moves_is_refused(made, bundle, tmp_path):
    path = tmp_path / "still.h5"
    write_recording(path, noise(60 * 6))
    with pytest.raises(UsageError, match="nothing moves in it"):
        own_windows(OwnClip(path, "pet"), bundle)
    path.write_bytes(b"no recording")
    with pytest.raises(RecordingError):
        own_windows(OwnClip(path, "pet"), bundle)


def test_sets_are_made_like_a_bundle(made, tmp_path, capsys):
    out = ("--out", str(tmp_path / "set"), "--passages", "2", "--workers", "1")
    assert main(["dataset", *out, "--like", str(made / "tiny.onnx")]) == 0
    about = json.loads((tmp_path / "set" / "manifest.json").read_text())["about"]
    assert about["settings"] == json.loads((made / "tiny.json").read_text())["features"]
    capsys.readouterr()
    assert main(["dataset", *out, "--like", "thesis"]) == 2
    assert "--like thesis: it takes thesis_type2" in capsys.readouterr().err


def test_a_guard_that_does_not_fit_is_refused(made, bundle, tmp_path):
    with pytest.raises(UsageError, match="128 windows of people; at least 500"):
        load_guard([made / "mix"], bundle)
    about = {"kind": "windows", "settings": {**settings(), "dwell_s": 3.0}}
    ShardSet(tmp_path / "other", about).write("shard-00000", toy(12))
    with pytest.raises(UsageError, match="dataset --like tiny"):
        load_guard([tmp_path / "other"], bundle, least=1)
    with pytest.raises(UsageError, match="tells human, pet apart"):
        load_guard([made / "mix"], replace(bundle, classes=("human", "pet")), least=1)


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        ((), "no clips: give FILE=LABEL"),
        (("x.h5=pet",), "x.h5: no such recording"),
        (("DOG=pet", "--clips", "somewhere"), "there is no --labels"),
        (("DOG=pet", "--full"), "--full needs --mix"),
        (("DOG=pet", "--mix", "GUARD"), "share a set"),
        (("DOG=pet", "--epochs", "0"), "--epochs 0"),
        (("DOG=pet", "--seed", "-1"), "--seed -1"),
        (("DOG=pet", "--name", "tiny"), "--name tiny"),
        (("DOG=human",), "nothing to quieten"),
        (("--labels", "missing.jsonl"), "cannot read the labels"),
    ],
)
def test_wrong_input_gets_one_line(made, tmp_path, argv, words, capsys):
    names = {"DOG": str(made / "dog1.h5"), "GUARD": str(made / "guard")}
    for name, path in names.items():
        argv = [text.replace(name, path) for text in argv]
    assert finetune(made, *argv, "--out", str(tmp_path / "out")) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_verifier_that_would_hide_people_is_not_written(made, tmp_path, capsys, monkeypatch):
    # As if no person might be touched at all, and every own window looked like one.
    monkeypatch.setattr("x2train.finetune.verifier._lowest", lambda *_: 1e9)
    assert finetune(made, *dogs(made), "--out", str(tmp_path / "out")) == 2
    err = capsys.readouterr().err
    assert "nothing was written" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()
