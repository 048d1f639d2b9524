"""docs/troubleshooting.md quotes what the programs say, and their exit codes."""

import re
from pathlib import Path

import pytest

from radard import errors
from radard.cli import main
from x2radar import errors as driver_errors

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


def rows(*headings):
    """First cells of the tables below some headings."""
    parts = re.split(r"^## (.*)$", PAGE, flags=re.MULTILINE)
    for heading, text in zip(parts[1::2], parts[2::2], strict=True):
        if heading in headings:
            found = re.findall(r"^\| ([^|]+) \|", text, re.MULTILINE)
            assert len(found) > 2
            yield from found[1:]


@pytest.fixture(scope="module")
def source():
    files = (*(ROOT / "daemon").rglob("*.py"), *(ROOT / "x2radar").rglob("*.py"))
    return "\n".join(path.read_text("utf-8") for path in files)


def test_every_message_is_one_of_the_programs(source):
    headings = ("The radar does not answer", "radard does not start", "The state is not online")
    quoted = [text for cell in rows(*headings) for text in re.findall(r"`([^`]+)`", cell)]
    assert len(quoted) > 25
    for text in quoted:
        # A number that the program fills in.
        pattern = re.sub(r"\\? (\d+(?:\\\.\d+)?) ", r" .+ ", re.escape(text).replace(r"\ ", " "))
        parts = text.split(": ")
        assert re.search(pattern, source) or all(part in source for part in parts), text


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


def test_exit_codes_are_those_of_the_errors():
    raised = [
        each
        for module in (errors, driver_errors)
        for each in vars(module).values()
        if isinstance(each, type) and issubclass(each, Exception)
    ]
    codes = {each.exit_code for each in raised if hasattr(each, "exit_code")}
    assert {int(cell) for cell in rows("Exit codes")} == {0, *codes}
