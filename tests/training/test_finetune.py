"""Finetuning: own clips quieten a pet, the guard holds, and what does not fit is refused."""

import itertools
import json
import shutil
from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest

from radard.errors import UsageError
from radard.judge.bundle import CLASSES, load_bundle
from radard.web.labels import add_label
from tests import training_helpers as small
from tests.alarm_helpers import write_recording
from tests.radar_helpers import run_radard
from x2train.cli import main
from x2train.finetune.finetune import Guard, load_guard
from x2train.finetune.own_clips import OwnClip, judge_of, labelled_clips, merged, named_clips
from x2train.nets.bundle_answers import Answers

pytestmark = pytest.mark.integration

ULID = "01J0000000000000000000000"


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory):
    """Return what makes a folder: a bundle that takes all for people, guards, clips of a dog."""
    clips = tmp_path_factory.mktemp("clips")
    for seed in (1, 2, 3):
        port = f"sim:dog_trot?seed={seed}"
        argv = ("--port", port, "--model", "none", "--speed", "max", "--duration", "8")
        record = ("--record", str(clips / f"dog{seed}.h5"), "-o", "null")
        assert run_radard(*argv, *record)[0] == 0

    @cache
    def make(kind):
        folder = tmp_path_factory.mktemp(kind)
        shutil.copytree(clips, folder, dirs_exist_ok=True)
        small.write_tiny(folder, replace(small.tiny()[0], temperature=12.0))
        if kind == "temporal":
            small.give_head(folder / "tiny.onnx", temperature=2.5)
        small.write_set(folder / "guard", small.toy(1536, seed=5), use="held out", seed=5)
        small.write_set(folder / "mix", small.toy(384, seed=6), use="held out", seed=6)
        return folder

    return make


@pytest.fixture(scope="module", params=["summed", "temporal"])
def each(request, folder_of):
    return folder_of(request.param)


@pytest.fixture(scope="module")
def each_bundle(each):
    return load_bundle(str(each / "tiny.onnx"))


@pytest.fixture(scope="module")
def made(folder_of):
    return folder_of("summed")


def finetune(made, *argv):
    sets = ("--guard", str(made / "guard"), "--mix", str(made / "mix"))
    return main(["finetune", *sets, "--model", str(made / "tiny.onnx"), *argv])


def dogs(made):
    return [f"{made / name}.h5=pet" for name in ("dog1", "dog2", "dog3")]


def test_who_names_no_bundle_begins_with_the_one_that_judged_the_clips(made, tmp_path, capsys):
    path = tmp_path / "upper_band.h5"
    upper_band = {"carrier_hz": 8.748e9, "bandwidth_hz": 1.5e9, "bin_length_m": 0.0514}
    write_recording(path, np.zeros((120, 96), np.complex64), **upper_band)
    assert judge_of([OwnClip(path, "pet")]) == "x4m03"
    assert judge_of([OwnClip(made / "dog1.h5", "pet")]) == "accurate"
    assert judge_of([]) == "accurate"
    sets = ("--guard", str(made / "guard"), "--mix", str(made / "mix"))
    assert main(["finetune", f"{path}=pet", *sets, "--name", "x4m03"]) == 2
    assert "a name of its own" in capsys.readouterr().err


def test_own_clips_become_quiet_and_radard_runs_the_bundle(each, each_bundle, tmp_path, capsys):
    # By the dashboard's labels, and, for the bundle with a head, by name.
    is_labelled = not each_bundle.n_hidden
    out = ("--out", str(tmp_path), "--epochs", "20")
    clips = [(str(k), "pet", str(each / f"dog{k}.h5"), "alarm") for k in (1, 2, 3)]
    gone = ("4", "pet", str(each / "gone.h5"), "alarm")
    labels = ["--labels", str(label_file(tmp_path, *clips, gone))]
    assert finetune(each, *(labels if is_labelled else dogs(each)), *out) == 0
    said = capsys.readouterr().out
    assert "wrote" in said
    assert (f"left out: {ULID}4: its clip is gone" in said) is is_labelled
    sidecar = json.loads((tmp_path / "own.json").read_text())
    base = json.loads((each / "tiny.json").read_text())
    same = ("schema", "inputs", "features", "stream", "classes", "temperature", "pet_limit")
    assert {k: sidecar[k] for k in same} == {k: base[k] for k in same}
    assert sidecar.get("hidden") == base.get("hidden")
    assert sidecar["evidence"] == base["evidence"]
    about = sidecar["training"]["finetuned"]
    assert about["base_onnx_sha256"] == base["onnx_sha256"]
    assert "of the way from the old weights" in about["detail"]
    assert [clip["file"] for clip in about["own"]] == ["dog1.h5", "dog2.h5", "dog3.h5"]
    # Where somebody keeps recordings is nobody's business.
    assert str(each / "dog1") not in (tmp_path / "own.json").read_text()
    metrics = sidecar["metrics"]
    assert metrics["own clips of pets with an alarm, before"] == 3
    assert metrics["own clips of pets with an alarm, after"] == 0
    for what in ("windows", "passages", "fused"):
        rise = metrics[f"people missed, {what}, after"] - metrics[f"people missed, {what}, before"]
        assert rise <= 0.0015
    assert "own clips of pets with an alarm | 3 of 3" in (tmp_path / "own.md").read_text()
    port = f"replay:{each / 'dog1.h5'}"
    for model, has_alarm in ((each / "tiny.onnx", True), (tmp_path / "own.onnx", False)):
        code, records, _ = run_radard("--port", port, "--model", str(model), "-o", "json")
        assert code == 0
        assert any(r.get("alarm") for r in records if r["type"] == "decision") is has_alarm


@pytest.mark.parametrize("policy", ["fused", "window"])
def test_misses_count_people_alone_by_the_policy(each_bundle, policy):
    bundle = replace(each_bundle, policy=policy)
    guard = Guard(small.toy(96), ({},))
    sure = np.zeros((96, 3))
    # Everybody is a pet: all people are missed; everybody is a person: none is.
    for column, missed in ((1, True), (0, False)):
        sure[:] = 0
        sure[:, column] = 10 * bundle.temperature
        fused = sure / bundle.temperature if bundle.n_hidden else None
        found = guard.misses(bundle, Answers(sure, fused))
        n_windows = int((guard.label == 0).sum())
        assert found["windows"] == (missed * n_windows, n_windows)
        assert found["passages"] == (missed * n_windows // 4, n_windows // 4)
    assert set(guard.of_people().label) == {CLASSES.index("human")}


def label_file(tmp_path, *lines):
    path = tmp_path / "labels.jsonl"
    for event, label, clip, kind in lines:
        add_label(path, {"event": ULID + event, "label": label, "clip": clip, "kind": kind})
    return path


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
    clips, left_out = labelled_clips(path)
    assert [(c.path.name, c.label) for c in clips] == [("dog1.h5", "pet"), ("dog2.h5", "wrong")]
    said = "; ".join(left_out)
    assert "its clip is gone" in said
    assert "not an alarm" in said
    assert "no clip was kept" in said
    moved, _ = labelled_clips(path, made)
    assert [c.path for c in moved] == [made / "dog1.h5", made / "dog2.h5"]


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


def test_a_guard_that_does_not_fit_is_refused(made, tmp_path):
    bundle = load_bundle(str(made / "tiny.onnx"))
    with pytest.raises(UsageError, match="128 windows of people; at least 500"):
        load_guard([made / "mix"], bundle)
    other = {**asdict(small.FEATURES), "dwell_s": 3.0}
    small.write_set(tmp_path / "other", small.toy(12), settings=other)
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
        (("DOG=pet", "--mix", "GUARD"), "share a set"),
        (("DOG=pet", "--epochs", "0"), "--epochs 0"),
        (("DOG=pet", "--name", "tiny"), "--name tiny"),
        (("--labels", "missing.jsonl"), "cannot read the labels"),
    ],
)
def test_wrong_input_gets_one_line(made, tmp_path, argv, words, capsys):
    for name, path in {"DOG": str(made / "dog1.h5"), "GUARD": str(made / "guard")}.items():
        argv = [text.replace(name, path) for text in argv]
    assert finetune(made, *argv, "--out", str(tmp_path / "out")) == 2
    assert words in small.one_line(capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("n_missed", "words"), [(2, "0.15 points more"), (0, "of 3 own clips of pets")]
)
def test_what_hides_people_or_calms_no_pet_is_not_written(
    made, tmp_path, capsys, monkeypatch, n_missed, *, words
):
    first, later = ({"windows": (n, 1000), "passages": (0, 250)} for n in (0, n_missed))
    misses = itertools.chain([first], itertools.repeat(later))
    monkeypatch.setattr(Guard, "misses", lambda *_: next(misses))
    # Hardly trained, three dogs are three people still.
    monkeypatch.setattr("x2train.finetune.finetune._FASTEST", 1e-9)
    out = ("--epochs", "1", "--out", str(tmp_path / "out"))
    assert finetune(made, *dogs(made), *out) == 2
    err = capsys.readouterr().err.splitlines()[-1]
    assert words in err
    assert "nothing was written" in err
    assert not (tmp_path / "out").exists()
