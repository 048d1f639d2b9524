"""`train-export leave-one-out`: every law is left out once, and the figures are kept."""

import json

import numpy as np
import pytest

from radard.errors import UsageError
from research.leave_one_out.measure import Law, laws_of
from x2train.cli import main

DATASET = ["--passages", "80", "--workers", "1", "--radar", "x2", "--plain", "1"]
LAWS = ["--motion", "gait", "footfalls", "--skin", "surface", "points"]


@pytest.fixture(scope="module")
def laws(tmp_path_factory):
    folder = tmp_path_factory.mktemp("laws") / "set"
    assert main(["dataset", "--out", str(folder), *DATASET, *LAWS]) == 0
    return folder


def test_every_law_is_left_out_once_and_nothing_is_done_twice(laws, tmp_path, capsys):
    out = tmp_path / "left-out.json"
    argv = ["leave-one-out", "--sets", str(laws), "--epochs", "1", "--out", str(out)]
    assert main(argv) == 0
    figures = json.loads(out.read_text())
    names = ["motion gait", "motion footfalls", "skin surface", "skin points"]
    assert list(figures) == ["nothing", *names]
    assert all(list(row) == names for row in figures.values())
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("without motion gait: ")
    # An interrupted run goes on: what is in the file is taken from there.
    figures["nothing"]["skin points"] = 0.25
    out.write_text(json.dumps(figures))
    assert main(argv) == 0
    assert "skin points 0.250\nwithout motion gait" in capsys.readouterr().out


def test_a_law_marks_its_people_and_pets_and_no_things():
    columns = {
        "motion": np.array([0, 1, 1, 1]),
        "skin": np.array([0, 0, 1, 1]),
        "label": np.array([0, 0, 1, 2]),
    }
    assert Law("motion", "footfalls").of(columns).tolist() == [False, True, True, False]
    assert len(laws_of(columns)) == 4
    with pytest.raises(UsageError, match="one motion and one skin"):
        laws_of({"motion": np.zeros(3), "skin": np.zeros(3), "label": np.zeros(3)})


def test_shares_are_shares(capsys, tmp_path):
    assert main(["dataset", "--out", str(tmp_path / "x"), "--physical", "1.5"]) == 2
    assert "--physical 1.5: must be 0 to 1" in capsys.readouterr().err
