"""`train-export evaluate --recordings`: labelled recordings of one's own."""

import json

import numpy as np
import pytest

from tests.training_helpers import one_line
from x2radar.cli import main as x2radar_main
from x2train.cli import main
from x2train.judge.labelled import judge_labelled, read_list

pytestmark = pytest.mark.integration


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("labelled")
    for scene, seconds in (("demo", "28"), ("empty", "8")):
        argv = ["record", str(folder / f"{scene}.h5"), "--port", f"sim:{scene}?seed=3"]
        assert x2radar_main([*argv, "--duration", seconds, "--speed", "max"]) == 0
    return folder


CSV = """\
file,start,end,label
demo.h5,0,7,empty
demo.h5, 8, 27, pet
empty.h5,,,empty
"""


def test_rows_are_judged_and_reported(folder, tmp_path, capsys):
    (folder / "home.csv").write_text(CSV)
    out = tmp_path / "report"
    argv = ["evaluate", "--model", "fast", "--recordings", str(folder / "home.csv")]
    assert main([*argv, "--out", str(out)]) == 0
    made = json.loads((out / "report.json").read_text())
    assert "Bundle fast on home.csv" in json.dumps(made)
    assert (out / "report.html").exists()
    assert capsys.readouterr().out.count("\n") == 1
    # Another list is not written over it, and is compared only with its own.
    assert main([*argv, "--out", str(out), "--card"]) == 2


def test_yaml_is_the_same_as_csv(folder):
    (folder / "home.csv").write_text(CSV)
    (folder / "home.yaml").write_text(
        "- {file: demo.h5, start: 0, end: 7, label: empty}\n"
        "- {file: demo.h5, start: 8, end: 27, label: pet}\n"
        "- {file: empty.h5, label: empty}\n"
    )
    rows = read_list(folder / "home.csv")
    assert rows == read_list(folder / "home.yaml")
    table = judge_labelled(rows, "fast")
    assert table.label.tolist() == ["empty", "pet", "empty"]
    np.testing.assert_allclose(table.enters_s, [np.nan, 8.0, np.nan])
    assert table.duration_s == pytest.approx([7.0, 19.0, 8.0], abs=0.1)
    assert not table.chosen(table.label == "empty").is_alarm.any()
    pet = table.chosen(table.label == "pet")
    assert pet.is_open.any()
    assert (pet.t_s > 8).all()
    assert (pet.t_s <= 27).all()


@pytest.mark.parametrize(
    ("text", "words", "code"),
    [
        ("file,start,end,label\n", "must be a list", 2),
        ("file,label\nx.h5,cow\n", "row 1.label: input should be 'human'", 2),
        ("file,start,end,label\nx.h5,9,3,pet\n", "row 1: end 3: must be after start 9", 2),
        ("file,start,end,label\nx.h5,nan,3,pet\n", "row 1.start", 2),
        ("file,label,who\nx.h5,pet,me\n", "row 1.who: unknown key", 2),
        ("file,label\ngone.h5,pet\n", "gone.h5", 66),
        ("file,start,end,label\nempty.h5,0,1,pet\n", "empty.h5", 2),
    ],
)
def test_a_list_that_makes_no_sense_is_told_in_one_line(
    text, words, code, folder, *, tmp_path, capsys
):
    path = folder / "bad.csv"
    path.write_text(text)
    argv = ["evaluate", "--model", "fast", "--recordings", str(path), "--out", str(tmp_path / "r")]
    assert main(argv) == code
    assert words in one_line(capsys)
