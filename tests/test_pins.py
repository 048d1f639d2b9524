"""What ./run installs is pinned by version and hash, and audited where a database answers."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def locked():
    """Name to version and hashes of requirements.txt."""
    text = (ROOT / "requirements.txt").read_text().replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    found = {}
    for line in lines:
        name, version, rest = re.fullmatch(
            r"([a-z0-9-]+)==([\w.]+)((?: +--hash=\S+)+)", line
        ).groups()
        found[name] = version, re.findall(r"--hash=sha256:([0-9a-f]{64})\b", rest)
    return found


def pinned():
    text = (ROOT / "constraints.txt").read_text()
    pairs = re.findall(r"^([\w.-]+)==(\S+)$", text, re.MULTILINE)
    return {re.sub(r"[._-]+", "-", name).lower(): version for name, version in pairs}


def test_every_pin_of_the_daemon_has_hashes_and_is_the_constraint():
    lock = locked()
    assert len(lock) > 15
    for name, (version, hashes) in lock.items():
        assert hashes
        assert pinned()[name] == version


def test_all_that_the_daemon_needs_is_there():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["daemon"]]
    names = {re.split(r"[\s<>=!~\[;]", each)[0].lower() for each in wanted}
    assert names | {"setuptools"} <= set(locked())


def test_run_takes_only_files_with_these_hashes(tmp_path):
    """The same function as ./run's, with a pip that says what it was asked."""
    (tmp_path / "tools").mkdir()
    for name in ("pyproject.toml", "constraints.txt", "requirements.txt", "tools/venv.sh"):
        (tmp_path / name).write_text((ROOT / name).read_text())
    python = tmp_path / ".venv/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text('#!/bin/sh\necho "$@" >> "$(dirname "$0")/asked"\n')
    python.chmod(0o755)
    asked = {}
    for extras in ("daemon", "daemon,train,dev"):
        script = f'. tools/venv.sh; ensure_venv "$PWD" {extras}; ensure_venv "$PWD" {extras}'
        subprocess.run(
            ["bash", "-euc", script],
            cwd=tmp_path,
            check=True,
            env={"PATH": "/usr/bin:/bin", "PYTHON": sys.executable},
            capture_output=True,
        )
        asked[extras] = (tmp_path / ".venv/bin/asked").read_text().splitlines()
        (tmp_path / ".venv/bin/asked").unlink()
    for lines in asked.values():
        # Once, since the stamp says that it was done.
        assert len(lines) == 2
        assert "--require-hashes --requirement" in lines[0]
        assert "--no-build-isolation" in lines[1]
    assert "--no-index" in asked["daemon"][1]
    assert "--no-index" not in asked["daemon,train,dev"][1]


def test_a_stranger_s_file_is_refused(tmp_path):
    """pip itself, with a wheel whose name is right and whose bytes are not."""
    wheel = tmp_path / f"h11-{locked()['h11'][0]}-py3-none-any.whl"
    wheel.write_bytes(b"PK not what was pinned")
    want = tmp_path / "want.txt"
    want.write_text(f"h11=={locked()['h11'][0]} --hash=sha256:{locked()['h11'][1][0]}\n")
    pip = [sys.executable, "-m", "pip", "download", "--isolated", "--no-index", "--no-deps"]
    said = subprocess.run(
        [*pip, "--find-links", str(tmp_path), "--require-hashes", "-r", str(want)]
        + ["-d", str(tmp_path / "out")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert said.returncode != 0
    assert "DO NOT MATCH THE HASHES" in said.stderr


@pytest.mark.parametrize("name", ["run", "test", ".ci/run"])
def test_all_scripts_install_by_the_same_function(name):
    text = (ROOT / name).read_text()
    assert "ensure_venv" in text
    assert "pip install" not in re.sub(
        r"(?m)^.*(playwright|pip-audit).*\n?", "", text.replace("\\\n", " ")
    )
