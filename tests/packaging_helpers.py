"""A copy of the source as an installer gets it, and what is built from it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PARTS = (
    *("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE", "CHANGELOG.md", "CONTRIBUTING.md"),
    *(
        "config.yaml",
        "constraints.txt",
        "requirements.txt",
        "x2radar",
        "daemon",
        "training",
        "models",
        "deploy",
        "docs",
    ),
    "tools",
)
_NOISE = shutil.ignore_patterns("__pycache__", "*.egg-info", "images", "*.png.tmp")
_BUILD = "import sys, build_backend; print(getattr(build_backend, sys.argv[1])(sys.argv[2]))"


def copy_source(folder):
    """Copy what a distribution is built from; links stay links."""
    folder.mkdir(parents=True)
    for part in PARTS:
        source = ROOT / part
        if source.is_dir():
            shutil.copytree(source, folder / part, symlinks=True, ignore=_NOISE)
        else:
            shutil.copy(source, folder / part)
    return folder


def build(what, source, out, *, epoch="1700000000", umask=0o022):
    """Run a hook of the build backend (`build_wheel`, `build_sdist`) as a build front end does."""
    out.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(
        [sys.executable, "-c", _BUILD, what, str(out)],
        cwd=source,
        env={**os.environ, "PYTHONPATH": str(source / "tools"), "SOURCE_DATE_EPOCH": epoch},
        umask=umask,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return out / done.stdout.splitlines()[-1]
