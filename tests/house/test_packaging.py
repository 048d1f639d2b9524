"""The source distribution and the wheel: what is in them, and that they are always the same."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest

from tests.packaging_helpers import ROOT, build, copy_source
from x2radar.distribution import DISTRIBUTION

MODULES = {"radard": "radard", "x2radar": "x2radar", "x2train": "train-export"}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Sdist and wheel, each built twice: from another folder, by another hand, at another time."""
    folder = tmp_path_factory.mktemp("built")
    sources = [copy_source(folder / "here"), folder / "there/and further"]
    shutil.copytree(sources[0], sources[1], symlinks=True)
    for path in sources[1].rglob("*"):
        if not path.is_symlink():
            path.chmod(0o775 if path.is_dir() or os.access(path, os.X_OK) else 0o664)
            os.utime(path, (1e9, 1e9))
    # What an earlier build has left behind.
    (sources[1] / "build/lib/radard").mkdir(parents=True)
    (sources[1] / "build/lib/radard/gone.py").write_text("")
    first = {}
    for what in ("build_sdist", "build_wheel"):
        made = [
            build(what, source, folder / f"out{k}", umask=(0o022, 0o002)[k])
            for k, source in enumerate(sources)
        ]
        assert made[0].name == made[1].name
        assert made[0].read_bytes() == made[1].read_bytes(), what
        first[what] = made[0]
    return first


def test_builds_are_reproducible_and_their_dates_are_those_asked_for(built):
    with zipfile.ZipFile(built["build_wheel"]) as wheel:
        assert {info.date_time for info in wheel.infolist()} == {(2023, 11, 14, 22, 13, 20)}
        assert {(info.external_attr >> 16) & 0o777 for info in wheel.infolist()} == {0o644}
        assert wheel.testzip() is None
    with tarfile.open(built["build_sdist"]) as sdist:
        assert {info.mtime for info in sdist} == {1_700_000_000}
        assert {(info.uid, info.gid, info.uname) for info in sdist} == {(0, 0, "")}
        assert all(info.isfile() for info in sdist)


def test_a_wheel_from_the_sdist_is_the_wheel_from_the_source(built, tmp_path):
    with tarfile.open(built["build_sdist"]) as sdist:
        sdist.extractall(tmp_path, filter="data")
    (source,) = tmp_path.iterdir()
    again = build("build_wheel", source, tmp_path / "out")
    assert again.read_bytes() == built["build_wheel"].read_bytes()


def test_the_wheel_says_what_it_is_and_has_what_the_daemon_needs(built):
    with zipfile.ZipFile(built["build_wheel"]) as wheel:
        names = set(wheel.namelist())
        (info,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        meta = message_from_bytes(wheel.read(info))
        config = wheel.read("radard/units/config.yaml")
        scripts = wheel.read(info.replace("METADATA", "entry_points.txt")).decode()
    assert meta["Name"] == DISTRIBUTION
    assert "radar alarm" in meta["Summary"]
    assert all(
        url.partition(", ")[2].startswith("https://") for url in meta.get_all("Project-URL")
    )
    minors = {f"Programming Language :: Python :: 3.{k}" for k in (11, 12, 13)}
    assert minors <= set(meta.get_all("Classifier"))
    assert config == (ROOT / "config.yaml").read_bytes()
    assert set(re.findall(r"^([\w-]+) = ", scripts, re.MULTILINE)) == set(MODULES.values())
    for name in ("radard.service", "60-x2radar.rules", "radard.sysusers"):
        assert f"radard/units/{name}" in names
    assert "radard/models/accurate.onnx" in names
    assert "radard/web/static/index.html" in names
    assert not [name for name in names if "studies" in name or "gone" in name]
    # No package and no file of data was forgotten in pyproject.toml.
    ours = {"x2radar": "x2radar", "daemon/radard": "radard", "training/x2train": "x2train"}
    for folder, package in ours.items():
        for path in (ROOT / folder).rglob("*"):
            inside = path.relative_to(ROOT / folder)
            if path.is_file() and not {"__pycache__", "studies"} & set(inside.parts):
                assert str(package / inside) in names, path


def test_every_extra_that_a_message_names_is_there(built):
    with zipfile.ZipFile(built["build_wheel"]) as wheel:
        (info,) = (name for name in wheel.namelist() if name.endswith("METADATA"))
        extras = set(message_from_bytes(wheel.read(info)).get_all("Provides-Extra"))
    named = set()
    for folder in ("x2radar", "daemon", "training"):
        for path in (ROOT / folder).rglob("*.py"):
            text = path.read_text()
            named |= set(re.findall(re.escape(DISTRIBUTION) + r"\[(\w+)\]", text))
            # The name before this one.
            assert "x2radar[" not in text.replace("x2radar[{", ""), path
    assert named <= extras
    assert {"daemon", "train", "completion"} <= extras


@pytest.mark.parametrize(("module", "prog"), MODULES.items())
def test_each_runs_as_a_module(module, prog):
    done = subprocess.run(
        [sys.executable, "-m", module, "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith(f"{prog} ")


def test_the_wheel_installs_into_a_folder_of_its_own(built, tmp_path):
    # Without its dependencies, which need a network: metadata, scripts and files.
    target = tmp_path / "env"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    subprocess.run(
        [*pip, "--no-deps", "--no-index", "--target", str(target), str(built["build_wheel"])],
        check=True,
    )
    code = "import radard, x2radar, pathlib; print(radard.__file__, x2radar.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(target)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert all(Path(file).is_relative_to(target) for file in done.stdout.split())
    assert (target / "bin/radard").is_file()
