"""The Debian package of deploy/deb/build, without the packages of others: those need a network."""

import gzip
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from radard.commands.setup import files
from tests.packaging_helpers import ROOT, build, copy_source

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(shutil.which("dpkg-deb") is None, reason="no dpkg-deb here"),
]


@pytest.fixture(scope="module")
def deb(tmp_path_factory):
    folder = tmp_path_factory.mktemp("deb")
    wheel = build("build_wheel", copy_source(folder / "source"), folder / "wheel")
    environ = {
        **os.environ,
        "WHEEL": str(wheel),
        "PYTHON": sys.executable,
        "RADARD": f"{sys.executable} -m radard",
        "SOURCE_DATE_EPOCH": "1700000000",
        "COMPRESS": "gzip",
        "OTHERS": "none",
    }
    made = [ROOT / "deploy/deb/build", folder / "out"]
    return Path(subprocess.check_output(made, env=environ, text=True).strip())


def test_files_lie_where_debian_wants_them_and_scripts_are_sound(deb, tmp_path):
    content = tmp_path / "content"
    subprocess.run([shutil.which("dpkg-deb"), "-R", deb, content], check=True)
    opt = "/opt/radard/bin/radard"
    expected = {
        "usr/lib/systemd/system/radard.service": files.systemd_unit(Path(opt)),
        "usr/lib/systemd/system/radard@.service": files.systemd_instance_unit(Path(opt)),
        "usr/lib/udev/rules.d/60-x2radar.rules": files.udev_rules(),
        "usr/lib/sysusers.d/radard.conf": files.shipped("radard.sysusers"),
        "etc/radard/config.yaml": files.first_config(),
        "usr/share/doc/uwb-radar-alarm/copyright": (ROOT / "LICENSE").read_text(),
    }
    for name, text in expected.items():
        assert (content / name).read_text() == text, name
    for name in ("radard", "x2radar"):
        assert str((content / "usr/bin" / name).readlink()) == f"/opt/radard/bin/{name}"
        first = (content / "opt/radard/bin" / name).read_text().splitlines()[0]
        assert re.fullmatch(r"#!/opt/radard/bin/python[\d.]*", first)
        page = gzip.decompress((content / f"usr/share/man/man1/{name}.1.gz").read_bytes())
        assert page.startswith(b".TH " + name.upper().encode())
        assert (content / f"usr/share/bash-completion/completions/{name}").stat().st_size
        assert (content / f"usr/share/zsh/vendor-completions/_{name}").stat().st_size
    (packages,) = (content / "opt/radard/lib").glob("python3.*/site-packages")
    assert (packages / "radard/models/accurate.onnx").is_file()
    assert not list(content.rglob("__pycache__"))
    minor = sys.version_info.minor
    control = (content / "DEBIAN/control").read_text()
    assert f"python3 (>= 3.{minor}), python3 (<< 3.{minor + 1})" in control
    assert (content / "DEBIAN/conffiles").read_text() == "/etc/radard/config.yaml\n"
    for name in ("postinst", "prerm", "postrm"):
        script = content / "DEBIAN" / name
        assert script.stat().st_mode & 0o777 == 0o755
        subprocess.run(["/bin/sh", "-n", script], check=True)
        assert "set -e" in script.read_text()


def test_all_belongs_to_root_and_nothing_is_younger_than_asked_for(deb):
    listed = subprocess.check_output([shutil.which("dpkg-deb"), "-c", deb], text=True)
    rows = [line.split(None, 5) for line in listed.splitlines()]
    assert len(rows) > 100
    assert {row[1] for row in rows} == {"root/root"}
    assert all(row[3] <= "2023-11-14" for row in rows)
    assert not [row for row in rows if row[0][5] == "w" or row[0][8] == "w" if row[0][0] != "l"]
