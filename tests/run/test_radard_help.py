"""Help that people see first: on one screen, with examples, complete."""

import pytest

from radard import cli


def said(capsys, *argv):
    with pytest.raises(SystemExit) as ended:
        cli.main(list(argv))
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_first_help_fits_a_screen(capsys):
    lines = said(capsys, "-h").splitlines()
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize("name", cli._COMMANDS)
def test_every_command_shows_an_example(name, capsys):
    out = said(capsys, name, "--help")
    _, _, examples = out.partition("example")
    assert f"radard {name}" in examples
    assert max(map(len, examples.splitlines())) <= 85
