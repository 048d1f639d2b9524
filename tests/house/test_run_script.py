"""./run: the demo unless something names a port, pinned hashes, and an audit of them."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from tests.processes import ROOT, ran

pytestmark = pytest.mark.integration
SHIPPED = (ROOT / "config.yaml").read_text()
DEMO, PAGE = ["--port", "sim:demo"], ["-o", "json", "-o", "http://127.0.0.1:8434"]


@pytest.fixture
def asked(tmp_path):
    """A function that gives ./run's arguments to radard, in a folder with a configuration."""
    here = tmp_path / "checkout"
    (here / "tools").mkdir(parents=True)
    (here / ".venv/bin").mkdir(parents=True)
    shutil.copy(ROOT / "run", here)
    (here / "tools/venv.sh").write_text("ensure_venv() { :; }\n")
    radard = here / ".venv/bin/radard"
    radard.write_text('#!/bin/sh\nfor word in "$@"; do echo "$word"; done\n')
    radard.chmod(0o755)

    def ask(*words, config=SHIPPED, **environ):
        (tmp_path / "config.yaml").write_text(config)
        done = subprocess.run(
            [here / "run", *words],
            cwd=tmp_path,
            env={"PATH": os.environ["PATH"], **environ},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.splitlines()

    return ask


def test_without_a_port_it_is_the_demo_and_what_is_named_stays(asked):
    for words in ([], ["--duration", "20"], ["--speed", "max"], ["-v"]):
        assert asked(*words) == [*words, *DEMO, *PAGE]
    assert asked("-o", "table") == ["-o", "table", *DEMO]
    assert asked("--port", "/dev/ttyACM0") == ["--port", "/dev/ttyACM0", *PAGE]
    for words in (["--help"], ["--version"], ["detect", "a.h5"], ["--config", "mine.yaml"]):
        assert asked(*words) == words


def test_a_port_of_configuration_or_environment_is_taken(asked):
    for config in (
        "sensor: {port: /dev/ttyACM0}\n",
        "sensor:\n  port: 'socket://10.0.0.5:4001'\n",
        "sensors:\n  hall: {port: sim:dog}\n",
        "sensor:\n  port: auto  # the only one\n",
    ):
        assert asked("--duration", "5", config=config) == ["--duration", "5", *PAGE]
    assert asked(config="sensor:\n  port: null\n# port: /dev/ttyACM0\n") == [*DEMO, *PAGE]
    assert asked(RADARD_SENSOR__PORT="sim:cat", RADARD_OUTPUT="json") == []


def test_run_takes_only_files_with_these_hashes(tmp_path):
    """The same function as ./run's, with a pip that says what it was asked."""
    (tmp_path / "tools").mkdir()
    for name in ("pyproject.toml", "constraints.txt", "requirements.txt", "tools/venv.sh"):
        (tmp_path / name).write_text((ROOT / name).read_text())
    python = tmp_path / ".venv/bin/python"
    python.parent.mkdir(parents=True)
    editable = tmp_path / ".venv/lib/python3/site-packages/__editable__.radard.pth"
    editable.parent.mkdir(parents=True)
    editable.touch()
    python.write_text('#!/bin/sh\necho "$@" >> "$(dirname "$0")/asked"\n')
    python.chmod(0o755)

    def bash(script):
        environ = {"PATH": "/usr/bin:/bin", "PYTHON": sys.executable}
        argv = [shutil.which("bash"), "-euc", f". tools/venv.sh; {script}"]
        return subprocess.run(argv, cwd=tmp_path, check=True, env=environ, capture_output=True)

    asked = {}
    for extras in ("daemon", "daemon,train,dev"):
        bash(f'ensure_venv "$PWD" {extras}; ensure_venv "$PWD" {extras}')
        asked[extras] = (tmp_path / ".venv/bin/asked").read_text().splitlines()
        (tmp_path / ".venv/bin/asked").unlink()
    for lines in asked.values():
        # Once, since the stamp says that it was done.
        assert len(lines) == 2
        assert "--require-hashes --requirement" in lines[0]
        assert "--no-build-isolation" in lines[1]
    # A copy in place of the checkout is put right, whatever the stamp says.
    editable.unlink()
    assert b"installing" in bash('ensure_venv "$PWD" daemon').stderr
    assert "--no-index" in asked["daemon"][1]
    assert "--no-index" not in asked["daemon,train,dev"][1]


def test_an_audit_fails_for_what_is_known_and_is_a_stated_skip_without_a_database():
    """The script as .ci/run starts it, with reports of pip-audit."""
    clean = {"name": "h11", "version": "0.16.0", "vulns": []}
    bad = {"name": "idna", "version": "1.0", "vulns": [{"id": "PYSEC-1"}, {"id": "PYSEC-2"}]}
    unknown = {"name": "numpy", "skip_reason": "not found on PyPI"}
    for packages, code, words in (
        ([clean, unknown], 0, "audit: 1 of 2 packages looked up\n"),
        ([clean, bad], 1, "known vulnerabilities:\nidna 1.0: PYSEC-1, PYSEC-2\n"),
        ([unknown], 0, "audit skipped: "),
        (None, 0, "audit skipped: "),
    ):
        text = "no network" if packages is None else json.dumps({"dependencies": packages})
        said = ran(ROOT / "tools/audit.py", input=text)
        assert (said.returncode, words in said.stderr) == (code, True), said.stderr
