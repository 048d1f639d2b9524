"""What is built and pinned is what should be: `python tools/checks/package.py`.

Wheel and source distribution are built twice, from two folders, and must be the same bytes; the
wheel has every file of the three packages; a Debian package has its files where they belong; files
of deploy/ name what there is.
"""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from collections.abc import Iterator
from email import message_from_bytes
from pathlib import Path

ROOT = Path(__file__).parents[2]
PARTS = (
    *("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE", "CHANGELOG.md", "CONTRIBUTING.md"),
    *("config.yaml", "constraints.txt", "requirements.txt", "x2radar", "daemon", "training"),
    *("models", "deploy", "docs", "tools"),
)
_NOISE = shutil.ignore_patterns("__pycache__", "*.egg-info", "images", "*.png.tmp")
_BUILD = "import sys, build_backend; print(getattr(build_backend, sys.argv[1])(sys.argv[2]))"
_EPOCH = "1700000000"
sys.path[:0] = [str(ROOT), str(ROOT / "daemon"), str(ROOT / "training")]

from radard.commands.setup import files  # noqa: E402 - the path comes first
from x2radar.device.discovery import USB_IDS  # noqa: E402
from x2radar.extras import DISTRIBUTION  # noqa: E402

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SOURCES = {"x2radar": "x2radar", "daemon/radard": "radard", "training/x2train": "x2train"}
SCRIPTS = {"radard", "x2radar", "train-export"}


def copy_source(folder: Path) -> Path:
    """Copy what a distribution is built from, as an installer gets it; links stay links."""
    folder.mkdir(parents=True)
    for part in PARTS:
        source = ROOT / part
        if source.is_dir():
            shutil.copytree(source, folder / part, symlinks=True, ignore=_NOISE)
        else:
            shutil.copy(source, folder / part)
    return folder


def build(what: str, source: Path, out: Path, *, umask: int = 0o022) -> Path:
    """Run a hook of the build backend (`build_wheel`, `build_sdist`) as a build front end does."""
    out.mkdir(parents=True, exist_ok=True)
    environ = {**os.environ, "PYTHONPATH": str(source / "tools"), "SOURCE_DATE_EPOCH": _EPOCH}
    argv = [sys.executable, "-c", _BUILD, what, str(out)]
    given = {"cwd": source, "env": environ, "umask": umask}
    done = subprocess.run(argv, capture_output=True, text=True, check=False, **given)
    if done.returncode:
        sys.exit(done.stderr)
    return out / done.stdout.splitlines()[-1]


def built(folder: Path) -> tuple[dict[str, Path], list[str]]:
    """Build both twice, the second time by another hand and at another time."""
    sources = [copy_source(folder / "here"), folder / "there/and further"]
    shutil.copytree(sources[0], sources[1], symlinks=True)
    for path in sources[1].rglob("*"):
        if not path.is_symlink():
            path.chmod(0o775 if path.is_dir() or os.access(path, os.X_OK) else 0o664)
            os.utime(path, (1e9, 1e9))
    left_over = sources[1] / "build/lib/radard"
    left_over.mkdir(parents=True)
    (left_over / "gone.py").write_text("")
    made, complaints = {}, []
    for what in ("build_sdist", "build_wheel"):
        pair = [
            build(what, s, folder / f"out{k}", umask=(18, 2)[k]) for k, s in enumerate(sources)
        ]
        if pair[0].read_bytes() != pair[1].read_bytes():
            complaints.append(f"{what}: two builds differ")
        made[what] = pair[0]
    with tarfile.open(made["build_sdist"]) as sdist:
        sdist.extractall(folder / "again", filter="data")
    (source,) = (folder / "again").iterdir()
    if (
        build("build_wheel", source, folder / "out2").read_bytes()
        != made["build_wheel"].read_bytes()
    ):
        complaints.append("the wheel of the source distribution is another one")
    return made, complaints


def content(wheel_path: Path) -> Iterator[str]:
    """Yield what is missing in the wheel, or should not be there."""
    with zipfile.ZipFile(wheel_path) as wheel:
        names = set(wheel.namelist())
        (info,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        meta = message_from_bytes(wheel.read(info))
        entry_points = wheel.read(info.replace("METADATA", "entry_points.txt")).decode()
        if wheel.read("radard/units/config.yaml") != (ROOT / "config.yaml").read_bytes():
            yield "wheel: units/config.yaml is not config.yaml"
    if set(re.findall(r"^([\w-]+) = ", entry_points, re.MULTILINE)) != SCRIPTS:
        yield "wheel: its commands are not the three"
    for folder, package in SOURCES.items():
        for path in (ROOT / folder).rglob("*"):
            inside = path.relative_to(ROOT / folder)
            if path.is_file() and "__pycache__" not in inside.parts:
                if str(package / inside) not in names:
                    yield f"wheel: no {package / inside}; see pyproject.toml"
    yield from (f"wheel: {name} is left over" for name in names if "gone" in name)
    yield from named_extras(set(meta.get_all("Provides-Extra") or ()))


def named_extras(extras: set[str]) -> Iterator[str]:
    """Yield extras that a message names and the project has not."""
    for folder in SOURCES:
        for path in (ROOT / folder).rglob("*.py"):
            for extra in re.findall(re.escape(DISTRIBUTION) + r"\[(\w+)\]", path.read_text()):
                if extra not in extras:
                    yield f"{path}: no extra {extra}"


def debian(wheel: Path, folder: Path) -> Iterator[str]:
    """Yield what is wrong in the Debian package, made without the packages of others."""
    dpkg = shutil.which("dpkg-deb")
    if dpkg is None:
        return
    given = {"WHEEL": str(wheel), "PYTHON": sys.executable, "OTHERS": "none", "COMPRESS": "gzip"}
    given |= {"RADARD": f"{sys.executable} -m radard", "SOURCE_DATE_EPOCH": _EPOCH}
    made = subprocess.check_output(
        [ROOT / "deploy/deb/build", folder / "deb"], env={**os.environ, **given}, text=True
    ).strip()
    deb = folder / "content"
    subprocess.run([dpkg, "-R", made, deb], check=True)
    yield from debian_files(deb)
    listed = subprocess.check_output([dpkg, "-c", made], text=True).splitlines()
    for mode, owner, _, day, rest in (line.split(None, 4) for line in listed):
        is_open = mode[0] != "l" and "w" in mode[5] + mode[8]
        if owner != "root/root" or day > "2023-11-14" or is_open:
            yield f"deb: {mode} {owner} {day} {rest}"


def debian_files(deb: Path) -> Iterator[str]:
    """Yield what is wrong among the unpacked files, with the control files below DEBIAN."""
    program = Path("/opt/radard/bin/radard")
    expected = {
        "usr/lib/systemd/system/radard.service": files.systemd_unit(program),
        "usr/lib/systemd/system/radard@.service": files.systemd_instance_unit(program),
        "usr/lib/udev/rules.d/60-x2radar.rules": files.udev_rules(),
        "usr/lib/sysusers.d/radard.conf": files.shipped("radard.sysusers"),
        "etc/radard/config.yaml": files.first_config(),
        "usr/share/doc/uwb-radar-alarm/copyright": (ROOT / "LICENSE").read_text(),
        "DEBIAN/conffiles": "/etc/radard/config.yaml\n",
    }
    yield from (f"deb: {n} is another" for n, t in expected.items() if (deb / n).read_text() != t)
    for name in ("radard", "x2radar"):
        first = (deb / "opt/radard/bin" / name).read_text().splitlines()[0]
        if not re.fullmatch(r"#!/opt/radard/bin/python[\d.]*", first):
            yield f"deb: {name} begins with {first}"
        if str((deb / "usr/bin" / name).readlink()) != f"/opt/radard/bin/{name}":
            yield f"deb: usr/bin/{name} is no link to it"
        for path in (f"man/man1/{name}.1.gz", f"bash-completion/completions/{name}"):
            if not (deb / "usr/share" / path).stat().st_size:
                yield f"deb: {path} is empty"
    if not list((deb / "opt/radard/lib").glob("python3.*/site-packages/radard/models/*.onnx")):
        yield "deb: no bundles"
    yield from (f"deb: {path} is left over" for path in deb.rglob("__pycache__"))
    minor = sys.version_info.minor
    wanted = f"python3 (>= 3.{minor}), python3 (<< 3.{minor + 1})"
    if wanted not in (deb / "DEBIAN/control").read_text():
        yield "deb: control names another Python"
    for name in ("postinst", "prerm", "postrm"):
        subprocess.run(["/bin/sh", "-n", deb / "DEBIAN" / name], check=True)


def deployed() -> Iterator[str]:
    """Yield what files of deploy/ name and is not there."""
    rules = (ROOT / "deploy/udev/60-x2radar.rules").read_text()
    ids = re.findall(r'idVendor\}=="(\w+)", ATTRS\{idProduct\}=="(\w+)"', rules)
    if {f"{vendor}:{product}" for vendor, product in ids} != set(USB_IDS):
        yield "60-x2radar.rules: its USB ids are not those of x2radar.device.discovery"
    if set(re.findall(r'GOTO="(\w+)"', rules)) != set(re.findall(r'LABEL="(\w+)"', rules)):
        yield "60-x2radar.rules: a GOTO without its LABEL"
    container = (ROOT / "deploy/container/Containerfile").read_text().replace("\\\n", " ")
    copied = {
        name
        for line in re.findall(r"^COPY (?!--from)(.+)$", container, re.MULTILINE)
        for name in line.split()[:-1]
    }
    yield from (f"Containerfile: no {name}" for name in copied if not (ROOT / name).exists())
    needed = {"x2radar", "daemon", "training", "models", "requirements.txt", "config.yaml"}
    yield from (f"Containerfile: does not copy {name}" for name in needed - copied)
    if "--require-hashes --requirement requirements.txt" not in container:
        yield "Containerfile: installs without hashes"


def main() -> int:
    """Print what is wrong; return 1 if there is anything."""
    with tempfile.TemporaryDirectory() as name:
        made, found = built(Path(name))
        wheel = made["build_wheel"]
        found += [*content(wheel), *debian(wheel, Path(name)), *deployed()]
        if subprocess.run(
            [sys.executable, "-m", "check_wheel_contents", made["build_wheel"]],
            cwd=ROOT,
            check=False,
        ).returncode:
            found.append("check-wheel-contents complains")
    for line in found:
        print(line)
    print(f"package: {len(found)} complaints")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
