"""What is installed is what was pinned: `python tools/checks/pins.py`.

Pins have hashes; ./run installs nothing else, and once; an audit of them fails for what is known.
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def pins() -> Iterator[str]:
    """Yield what of the daemon is not pinned by version and hash."""
    text = (ROOT / "requirements.txt").read_text().replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    locked = {}
    for line in lines:
        found = re.fullmatch(r"([a-z0-9-]+)==([\w.]+)(?: +--hash=sha256:[0-9a-f]{64})+\s*", line)
        if found is None:
            yield f"requirements.txt: no hash in '{line[:60]}'"
        else:
            locked[found[1]] = found[2]
    text = (ROOT / "constraints.txt").read_text()
    pinned = {
        re.sub(r"[._-]+", "-", name).lower(): version
        for name, version in re.findall(r"^([\w.-]+)==(\S+)$", text, re.MULTILINE)
    }
    for name, version in locked.items():
        if pinned.get(name) != version:
            yield f"constraints.txt: {name} is not {version}"
    wanted = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["daemon"]]
    for name in {re.split(r"[\s<>=!~\[;]", each)[0].lower() for each in wanted} | {"setuptools"}:
        if name not in locked:
            yield f"requirements.txt: {name} is missing"


def installs() -> Iterator[str]:
    """Yield where ./run's own function would ask pip for anything but files with these hashes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "tools").mkdir()
        for each in ("pyproject.toml", "constraints.txt", "requirements.txt", "tools/venv.sh"):
            shutil.copy(ROOT / each, folder / each)
        python, asked = folder / ".venv/bin/python", folder / ".venv/bin/asked"
        editable = folder / ".venv/lib/python3/site-packages/__editable__.radard.pth"
        for each in (python, editable):
            each.parent.mkdir(parents=True)
        editable.touch()
        # A pip that says what it was asked.
        python.write_text('#!/bin/sh\necho "$@" >> "$(dirname "$0")/asked"\n')
        python.chmod(0o755)
        for extras in ("daemon", "daemon,train,dev"):
            again = f'ensure_venv "$PWD" {extras}'
            bash(folder, f"{again}; {again}")
            lines = asked.read_text().splitlines()
            asked.unlink()
            # Once, since the stamp says that it was done.
            if len(lines) != 2:
                yield f"venv.sh: {extras}: asked {len(lines)} times"
            if "--require-hashes --requirement" not in lines[0]:
                yield f"venv.sh: {extras}: no hashes: {lines[0]}"
            is_local = "--no-index" in lines[1]
            if "--no-build-isolation" not in lines[1] or is_local != (extras == "daemon"):
                yield f"venv.sh: {extras}: {lines[1]}"
        # A copy in place of the checkout is put right, whatever the stamp says.
        editable.unlink()
        if "installing" not in bash(folder, 'ensure_venv "$PWD" daemon'):
            yield "venv.sh: a copy in place of the checkout stays"


def bash(folder: Path, script: str) -> str:
    """Run a script behind venv.sh; return what it says on stderr."""
    argv = [shutil.which("bash") or "bash", "-euc", f". tools/venv.sh; {script}"]
    environ = {"PATH": "/usr/bin:/bin", "PYTHON": sys.executable}
    given = {"capture_output": True, "text": True, "env": environ, "cwd": folder}
    return str(subprocess.run(argv, check=True, **given).stderr)  # type: ignore[call-overload]


def audits() -> Iterator[str]:
    """Yield where the audit passes over what is known, or fails for want of a database."""
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
        argv = [sys.executable, str(ROOT / "tools/audit.py")]
        done = subprocess.run(argv, input=text, capture_output=True, text=True, check=False)
        if done.returncode != code or words not in done.stderr:
            yield f"audit.py: {packages}: {done.returncode}, {done.stderr}"


def main() -> int:
    """Print what does not hold; return 1 if there is anything."""
    found = [*pins(), *installs(), *audits()]
    for line in found:
        print(line)
    print(f"pins: {len(found)} complaints")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
