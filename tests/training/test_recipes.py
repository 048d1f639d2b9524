"""`train-export make`: how shipped bundles come about, and that the commands are theirs."""

import argparse
import itertools
import json
import shlex
import sys
from pathlib import Path

import pytest

from radard.judge.bundle import load_bundle, sidecar_path
from x2train.bundle import recipes
from x2train.bundle.recipes import MOTION, RECIPES, arguments, recipe_of
from x2train.cli import main
from x2train.commands import make


@pytest.mark.parametrize("name", RECIPES)
def test_a_shipped_bundle_is_what_its_recipe_makes(name):
    training = json.loads(sidecar_path(name).read_text())["training"]
    assert training["command"] == " && ".join(RECIPES[name])
    assert recipe_of(training["command"]) == name
    card = sidecar_path(name).with_suffix(".md").read_text()
    motion = " --motion DIR" if any(MOTION in step for step in arguments(name)) else ""
    assert f"    train-export make {name}{motion}\n" in card
    assert ("on a GPU" in card) == (training.get("device") == "cuda")
    # The card names whose motion it has learned from.
    assert ("clips" in training) == bool(motion) == ("recorded and animated" in card)


@pytest.mark.parametrize("name", [n for n in RECIPES if n != "thesis"])
def test_sets_are_those_of_the_sidecar(name):
    abouts = json.loads(sidecar_path(name).read_text())["training"]["sets"]
    wanted = {
        (a["elements"], a["seed"], a["use"], a["radar"], a.get("longest_s", 6.0)) for a in abouts
    }
    made = set()
    for step in arguments(name):
        if step[0] == "dataset":
            options = dict(itertools.pairwise(step))
            use = "clips" if "--clips" in options else options.get("--families", "train")
            numbers = int(options["--passages"]), int(options["--seed"])
            others = options.get("--radar", "any"), float(options.get("--longest", 6))
            made.add((*numbers, use, *others))
    assert wanted <= made


def test_a_share_has_sets_and_a_folder_of_its_own(tmp_path, monkeypatch):
    *sets, last = arguments("balanced", share=0.01, workers=3, motion=Path("/clips"))
    assert sets[0] == shlex.split(
        "dataset --out sets-0.01/x2clear --families all --motion footfalls angles "
        "--skin points ellipsoids --radar x2 --clear 1 --plain 1 --longest 6 --seed 506 "
        "--passages 260 --workers 3"
    )
    assert not any(word.startswith("sets/") for step in (*sets, last) for word in step)
    assert recipe_of(f"train-export {shlex.join(last)}") is None
    for share, is_fast in ((0.001, False), (0.01, False), (0.05, True), (1.0, True)):
        fit = next(step for step in arguments("x4m03", share=share) if step[0] == "fit")
        assert ("--half" in fit) == is_fast
    (thesis,) = arguments("thesis", share=0.01, models=tmp_path)
    assert thesis[-4:] == ["--workers", "1", "--share", "0.01"]
    smallest = [step for step in arguments("fast", share=1e-6) if step[0] == "dataset"]
    assert {step[step.index("--passages") + 1] for step in smallest} == {"12"}
    monkeypatch.chdir(tmp_path)
    for wrong in (["--share", "0"], ["--share", "2"], ["--workers", "0"]):
        assert main(["make", "fast", *wrong]) == 2


@pytest.mark.parametrize(("name", "n_clips"), [("accurate", 4), ("x4m03", 8), ("fast", 3)])
def test_recorded_motion_goes_on_from_generated(name, n_clips, tmp_path, capsys):
    steps = arguments(name, share=0.01, motion=Path("/clips"), models=tmp_path)
    # Parts lie in a folder of their own, and each is made before somebody needs it.
    made = []
    *parts, last = (step for step in steps if step[0] != "dataset")
    for step in (*parts, last):
        folder = tmp_path if step is last else tmp_path / "parts"
        assert step[step.index("--out") + 1] == str(folder)
        assert {word for word in step if word.endswith(".onnx")} <= set(made)
        made.append(f"{folder}/{step[step.index('--name') + 1]}.onnx")
    assert (parts[0][0], last[0]) == ("fit", "temporal")
    clips = [step for step in steps if "--clips" in step]
    assert all(step[step.index("--clips") + 1] == "/clips" for step in clips)
    assert len(clips) == n_clips
    assert main(["make", name]) == 2
    assert f"make {name}: needs --motion" in capsys.readouterr().err


@pytest.mark.nightly
def test_recipe_is_run_whole(tmp_path, monkeypatch, capsys):
    train, check = "--train sets/anyrooms", "--validate sets/check"
    tiny = (
        f"train-export fit {train} {check} --name tiny --size fast --epochs 1 --seed 0",
        f"train-export temporal --model models/tiny.onnx {train} sets/x4anycheck {check} "
        "--epochs 1 --seed 0",
    )
    monkeypatch.setattr(recipes, "RECIPES", {"tiny": tiny})
    monkeypatch.setattr("x2train.commands.make.RECIPES", recipes.RECIPES)
    monkeypatch.chdir(tmp_path)
    assert main(["make", "tiny", "--share", "0.0006", "--workers", "1", "--out", "mine"]) == 0
    assert load_bundle("mine/tiny.onnx").n_hidden
    assert "[5/5] train-export temporal --model mine/tiny.onnx" in capsys.readouterr().err
    assert "train-export make" not in (tmp_path / "mine" / "tiny.md").read_text()


def test_sets_of_later_steps_are_made_beside_the_training(tmp_path, monkeypatch, capsys):
    events = []

    class Beside:
        def __init__(self, argv, **_kwargs):
            events.append(argv)

        def wait(self):
            events.append("waited")

        def terminate(self):
            pass

    monkeypatch.setattr(make.subprocess, "Popen", Beside)
    parser = argparse.ArgumentParser()
    parser.set_defaults(train_export=lambda step: events.append(step[0]) or 0)
    make.register(parser.add_subparsers())
    args = parser.parse_args(["make", "generated", "--out", str(tmp_path), "--workers", "3"])
    assert args.run(args) == 0
    (began,) = (k for k, event in enumerate(events) if isinstance(event, list))
    assert events[:began] == ["dataset"] * 7
    assert events[began + 1 :][:2] == ["fit", "waited"]
    assert [e for e in events[began + 3 :] if e != "waited"] == ["dataset"] * 2 + ["temporal"]
    python, flag, module, *argv = events[began]
    assert (python, flag, module) == (sys.executable, "-m", "x2train")
    capsys.readouterr()
    assert main([*argv, "--show"]) == 0
    shown = capsys.readouterr().out
    assert shown.count("train-export dataset") == 9
    assert shown.count("--workers 2") == 9
