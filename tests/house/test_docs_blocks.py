"""Every command and block of code of the documentation runs, and every `>>>` of the packages.

A block that needs a module, other people's files or minutes has a comment before it, with the
reason: `<!-- not run: needs a module -->`. tools/checks/blocks.py parses those.
"""

import contextlib
import doctest
import importlib
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from radard.cli import main as radard
from tests.processes import environ
from tools.pages import PAGES, PROGRAMS, ROOT, blocks_of
from x2radar.cli import main as x2radar
from x2train.cli import main as train_export

MAINS = {"radard": radard, "x2radar": x2radar, "train-export": train_export}
BLOCKS = {path: list(blocks_of(path)) for path in PAGES}
ELSEWHERE = {"docs/research/extending.md": "house/test_extending.py"}
"""Pages whose blocks need more than a place to run: which test runs them."""
SHELL = re.compile(r"[|&;<>$`]|^\w+=")


@pytest.mark.integration
@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_page_runs(path, tmp_path, monkeypatch, capfd):
    page = str(path.relative_to(ROOT))
    blocks = [b for b in BLOCKS[path] if b.kind in {"sh", "python"} and not b.reason]
    if page in ELSEWHERE:
        assert (ROOT / "tests" / ELSEWHERE[page]).is_file()
        return
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RADARD_SERVICE__STATE_DIR", str(tmp_path / "state"))
    monkeypatch.setenv("RADARD_SERVICE__RUNTIME_DIR", str(tmp_path / "state"))
    names = {"__name__": "page"}
    for block in blocks:
        if block.kind == "python":
            exec(compile(block.text, block.name, "exec"), names)  # noqa: S102 - our own page
            continue
        for command in block.commands():
            assert run(command) == 0, (block.name, command, capfd.readouterr().err)


WITH_TRIALS = [path for path in PAGES if any(b.reason and any(b.tried()) for b in BLOCKS[path])]


@pytest.mark.nightly
@pytest.mark.parametrize("path", WITH_TRIALS, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_takes_long_runs_when_it_is_made_short(path, tmp_path, monkeypatch, capfd):
    """The page's own commands come before, since they may make what is needed."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    for name in ("benchmarks", "daemon", "research", "tests", "tools"):
        (tmp_path / name).symlink_to(ROOT / name)
    # What pages call the reader's own.
    (tmp_path / "models").mkdir()
    for file in (ROOT / "models").glob("fast.*"):
        shutil.copy(file, tmp_path / "models" / f"mine{file.suffix}")
    mine = [b.text for b in BLOCKS[path] if b.kind == "python" and "\ndef " in b.text]
    (tmp_path / "mine.py").write_text("\n\n".join(mine))
    for block in BLOCKS[path]:
        if block.kind == "python" and not block.reason:
            exec(compile(block.text, block.name, "exec"), {"__name__": "page"})  # noqa: S102
        if block.kind == "sh":
            for command in block.tried() if block.reason else block.commands():
                assert run(command) == 0, (block.name, command, capfd.readouterr().err)


def run(command):
    """Run a command, in this process where it is one of ours alone; return its exit code."""
    words = shlex.split(command)
    if words[0] in PROGRAMS and not SHELL.search(command):
        with contextlib.suppress(SystemExit):
            return MAINS[words[0]](words[1:])
        return 0
    folder = str(Path(sys.executable).parent)
    env = environ(PATH=f"{folder}:{os.environ['PATH']}")
    return subprocess.run(["bash", "-c", command], env=env, check=False).returncode  # noqa: S607


PACKAGES = {"x2radar": ROOT, "radard": ROOT / "daemon", "x2train": ROOT / "training"}


def _modules():
    for package, folder in PACKAGES.items():
        for path in sorted((folder / package).rglob("*.py")):
            if ">>> " in path.read_text("utf-8"):
                parts = path.relative_to(folder).with_suffix("").parts
                yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@pytest.mark.parametrize("name", list(_modules()))
def test_the_examples_of(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    done = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert done.failed == 0, capsys.readouterr().out
    found = doctest.DocTestFinder().find(module)
    assert any(each.examples for each in found), f"{name}: no docstring holds its example"
