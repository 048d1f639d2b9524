"""Wrong input gets the one line that docs/troubleshooting.md explains, and its exit code."""

from pathlib import Path

import pytest

from radard.cli import main

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text("utf-8")
SAID = {
    "radard --port /dev/nothing": (66, "no such port; is the module plugged in?"),
    "radard": (2, "no port: give --port"),
    "radard --port sim:nothing": (66, "no scene"),
    "radard --port sim:human --model nothing": (66, "no model"),
    "radard --port replay:damaged.h5": (66, "not an HDF5 file, or damaged"),
    "radard --port sim:human?rate=200 --model thesis -o null": (4, "does not fit this stream"),
    "radard --port sim:human -o http://0.0.0.0:8434": (78, "others can reach this address"),
    "radard --port sim:human -o mqtt://me:secret@broker": (2, "no password in the URL"),
    "radard config check --config misspelt.yaml": (78, "unknown key"),
    "radard --port sim:human?fault=safe_mode:1 -o null": (1, "is in fail-safe mode"),
    "radard calibrate --port sim:human --speed max --duration 25 --out c": (1, "is not empty"),
}


@pytest.mark.parametrize("command", SAID)
def test_what_a_command_says_stands_on_the_page(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("damaged.h5").write_text("x")
    Path("misspelt.yaml").write_text("gate: {treshold_db: 3}\n")
    code, text = SAID[command]
    assert main(command.split()[1:]) == code
    said = capsys.readouterr().err
    assert text in said
    assert said.count("\n") == 1
    assert text in PAGE
    assert not Path("c").exists()
