"""`radard detect`: the decisions of `radard --port replay:`, for many recordings, in a table."""

import csv
import io
import json
import os
import signal
import time
from pathlib import Path

import pytest
from pyarrow import parquet

from radard.cli import main as radard_main
from radard.commands.detect import COLUMNS
from tests.processes import hears_sigterm, started
from tests.radar_helpers import run_radard, stable
from tests.recording_helpers import record_scene, run
from tests.waiting import wait_for


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    gap = range(200, 208)
    return [
        record_scene(folder / f"{scene} 1.h5", scene, n=420, lost=gap)
        for scene in ("human", "dog")
    ]


def replayed(path, *argv):
    code, records, said = run_radard("--port", f"replay:{path}", "-o", "json", *argv)
    assert code == 0, said
    return [r for r in stable(records) if r["type"] in {"decision", "event"}]


def detect(capsys, *argv):
    return run(capsys, "detect", *argv, main=radard_main)


def test_decisions_and_events_are_those_of_a_replay(files, capsys):
    code, out, err = detect(capsys, *files, "--to", "jsonl", "--jobs", "1")
    assert (code, err) == (0, "")
    told = [json.loads(line) for line in out.splitlines()]
    for path in files:
        own = [r for r in told if r["file"] == str(path) and r["type"] in {"decision", "event"}]
        times = [r.pop("time") for r in own]
        assert times[0] == "2026-03-01T12:00:02.950Z"
        assert [{k: v for k, v in r.items() if k != "file"} for r in own] == replayed(path)
        assert "invalid" in {r.get("gate") for r in own}
    assert {r["model"] for r in told if r["type"] == "hello"} == {"accurate"}
    assert any(r["type"] == "event" and r["kind"] == "alarm" for r in told)


@pytest.mark.integration
def test_no_recording_is_overwritten_whatever_it_is_called(files, capsys, tmp_path):
    whole = files[0].read_bytes()
    for name in ("copy.h5", "copy.csv"):
        (tmp_path / name).write_bytes(whole)
        for given in (tmp_path / name, files[1]):
            code, out, err = detect(capsys, given, "--to", "csv", "--out", tmp_path / name)
            assert (code, out) == (66, "")
            assert "is a recording, which is not overwritten" in err
        assert (tmp_path / name).read_bytes() == whole


def is_there(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.integration
@pytest.mark.parametrize("is_alone", [True, False])
def test_a_signal_ends_all_of_its_processes_soon_and_without_a_word(files, tmp_path, is_alone):
    """Ctrl-C goes to the whole group: those that were at their imports showed where."""
    argv = ("-m", "radard", "detect", *files, *files, "--jobs", "2", "--out", tmp_path / "o.csv")
    for pause_s in (0.6, 1.2, 2.0):
        process = started(*argv, start_new_session=True)
        wait_for(lambda pid=process.pid: hears_sigterm(pid))
        time.sleep(pause_s)
        if is_alone:
            process.terminate()
        else:
            os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=60)
        assert (pause_s, process.returncode, out, err) == (pause_s, 0, b"", b"")
        wait_for(lambda pid=process.pid: not is_there(pid))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.integration
def test_every_core_makes_the_same_table(files, capsys, tmp_path):
    one = detect(capsys, *files, "--jobs", "1")
    assert detect(capsys, *files, "--jobs", "2") == one
    code, text, _ = one
    assert code == 0
    rows = list(csv.DictReader(io.StringIO(text)))
    assert list(rows[0]) == list(COLUMNS["decisions"])
    assert [row["file"] for row in rows] == sorted([row["file"] for row in rows], reverse=True)
    out = tmp_path / "all.parquet"
    assert detect(capsys, *files, "--out", out)[0] == 0
    table = parquet.read_table(out).to_pylist()
    assert len(table) == len(rows)
    for row, of_csv in zip(table, rows, strict=True):
        for name, value in row.items():
            wanted = "" if value is None else value
            wanted = str(wanted).lower() if isinstance(wanted, bool) else str(wanted)
            assert of_csv[name] == wanted, name
    first = replayed(files[0])[0]
    for name in ("seq", "t_s", "gate", "p_human", "label", "alarm", "power_db"):
        assert table[0][name] == first[name]


def test_one_without_a_decision_is_said(capsys, tmp_path):
    short = record_scene(tmp_path / "short.h5", "empty", n=100)
    code, out, err = detect(capsys, short, "--model", "none")
    assert (code, len(out.splitlines())) == (0, 1)
    assert err == f"radard: {short}: no decision: it is shorter than a window\n"
    assert detect(capsys, short, "--model", "none", "--rows", "events")[2] == ""


@pytest.mark.integration
def test_one_that_cannot_be_read_does_not_stop_the_others(files, capsys, tmp_path):
    out = tmp_path / "all.csv"
    gone = tmp_path / "gone.h5"
    code, _, err = detect(capsys, gone, files[0], "--jobs", "2", "--out", out)
    assert code == 66
    assert err.splitlines() == [
        f"radard: {gone}: no such recording",
        f"{out}: 6 decisions of 1 recording",
        "radard: 1 of 2 recordings could not be judged",
    ]
    assert len(out.read_text().splitlines()) > 2


TO = ("xlsx", "h5", "json")


@pytest.mark.parametrize(
    "case",
    [
        (["gone.h5"], 66, "radard: gone.h5: no such recording"),
        (["gone.h5", "--out", "old.csv"], 66, "radard: gone.h5: no such recording"),
        (["gone.h5", "--to", "parquet"], 2, "radard: --to parquet: a table like that needs --out"),
        *((["gone.h5", "--out", f"d.{to}"], 2, f"radard: --out d.{to}: no format") for to in TO),
        (["gone.h5", "--model", "gone"], 66, "radard: no model 'gone'"),
        (["gone.h5", "--sensor", "attic"], 2, "radard: no sensor 'attic'"),
        (["gone.h5", "--out", "gone/a.csv"], 1, "radard: --out gone/a.csv: cannot write"),
    ],
)
def test_what_cannot_be_done_is_one_line(capsys, tmp_path, monkeypatch, case):
    argv, code, said = case
    monkeypatch.chdir(tmp_path)
    Path("old.csv").write_text("kept")
    ended, _, err = detect(capsys, *argv)
    assert (ended, err.count("\n")) == (code, 1)
    assert err.startswith(said)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("old.csv", "kept")]
