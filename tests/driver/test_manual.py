"""Help, man pages and completion of the three commands: complete, and made from the parsers."""

import shutil
import subprocess

import pytest

from radard import cli as radard_cli
from tests.recording_helpers import run
from x2radar import cli as x2radar_cli
from x2radar import manual
from x2radar.command import Parser, nearest
from x2train import cli as training_cli

MAINS = {"radard": radard_cli.main, "x2radar": x2radar_cli.main, "train-export": training_cli.main}


@pytest.fixture(scope="module")
def trees():
    """The whole parser of each command, as its man page gets it."""
    seen = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(manual, "man_page", lambda parser: seen.update({parser.prog: parser}) or "")
        for main in MAINS.values():
            with pytest.raises(SystemExit):
                main(["--print-man"])
    assert set(seen) == set(MAINS)
    return seen


@pytest.mark.integration
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["radard", "walk"], {"walktest"}),
        (["radard", "arm", "--ho"], {"--home"}),
        (["radard", "--sensi"], {"--sensitivity"}),
        (["radard", "--sensitivity", ""], {"low", "normal", "high"}),
        (["radard", "setup", "cov"], {"coverage"}),
        (["x2radar", "sel"], {"selftest"}),
        (["x2radar", "record", "--capt"], {"--capture-wire"}),
    ],
)
def test_bash_completes(words, wanted, trees, tmp_path):
    script = tmp_path / "completion.bash"
    script.write_text(manual.completion(trees[words[0]], "bash"))
    line = " ".join(f"'{word}'" for word in words)
    code = (
        f"source {script}; function=$(complete -p {words[0]} | sed 's/.*-F //; s/ .*//'); "
        f"COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; $function; "
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    said = subprocess.check_output([shutil.which("bash"), "-c", code], text=True)
    assert set(said.split()) == wanted


def test_commands_print_both(capsys):
    for main, argv, words in (
        (x2radar_cli.main, ["--print-man"], ".TH X2RADAR 1"),
        (x2radar_cli.main, ["--print-completion", "bash"], "complete -"),
        (radard_cli.main, ["--print-man"], ".SS radard calibrate"),
    ):
        code, out, _ = run(capsys, *argv, main=main)
        assert (code, words in out) == (0, True)


@pytest.mark.parametrize(
    ("name", "argv", "wanted"),
    [
        ("radard", ["statsu"], "unrecognized arguments: statsu; did you mean 'status'?"),
        ("radard", ["--prot", "x"], "unrecognized arguments: --prot; did you mean '--port'?"),
        ("radard", ["--sensitivity", "hihg"], "did you mean 'high'?"),
        ("radard", ["events", "--limt=3"], "radard events: unrecognized arguments: --limt=3; did"),
        ("radard", ["setup", "udv"], "did you mean 'udev'?"),
        ("x2radar", ["reccord"], "invalid choice: 'reccord'; did you mean 'record'?"),
        # What it stood for is missing, too; but this says why.
        ("x2radar", ["record", "--prt", "sim:dog"], "--prt; did you mean '--port'?"),
        ("x2radar", ["frobnicate"], "invalid choice: 'frobnicate' (choose from ports, "),
        ("train-export", ["datset"], "did you mean 'dataset'?"),
    ],
)
def test_the_nearest_word_is_named(name, argv, wanted, capsys):
    code, _, err = run(capsys, *argv, main=MAINS[name])
    assert (code, wanted in err, err.count("\n")) == (2, True, 1)


def test_options_may_be_cut_short_and_what_follows_two_dashes_is_none():
    parser = Parser(prog="tool")
    parser.add_argument("--duration", type=float)
    parser.add_argument("files", nargs="*")
    args = parser.parse_args(["--dur", "3", "--", "--what"])
    assert (args.duration, args.files) == (3.0, ["--what"])
    assert nearest("horse", ["events"]) == ""
