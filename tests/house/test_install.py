"""What ./run installs has the pinned hashes, and is audited where a database answers."""

import json
import shutil
import subprocess
import sys

import pytest

from tests.processes import ROOT, ran

pytestmark = pytest.mark.integration


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
