"""Help that people see first: on one screen, with examples, complete."""

import re

import pytest

from radard import cli


def said(capsys, *argv):
    with pytest.raises(SystemExit) as ended:
        cli.main(list(argv))
    assert ended.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("option", ["-h", "--help"])
def test_first_help_fits_a_screen(option, capsys):
    lines = said(capsys, option).splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80


def test_first_help_names_every_option_and_command(capsys):
    short, full = said(capsys, "--help"), said(capsys, "--help-all")
    options = set(re.findall(r"--[a-z][a-z-]+", full)) - {"--help", "--verbose", "--quiet"}
    options -= {"--output"}
    assert {option for option in options if option not in short} == set()
    for name in cli._COMMANDS:
        assert re.search(rf"^  .*\b{name} ", short, re.MULTILINE)


@pytest.mark.parametrize("name", cli._COMMANDS)
def test_every_command_shows_an_example(name, capsys):
    out = said(capsys, name, "--help")
    _, _, examples = out.partition("example")
    assert f"radard {name}" in examples
    assert max(map(len, examples.splitlines())) <= 85
