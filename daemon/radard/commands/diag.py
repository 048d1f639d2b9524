"""`radard diag`: write a report of trouble without secrets.

Every part is gathered by itself: what fails says so in its own file and stops no other.
"""

import grp
import io
import json
import os
import platform
import re
import resource
import shutil
import sqlite3
import sys
import tarfile
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from radard.commands.config import shown
from radard.config.config import Config, found_file, load_with_origins
from radard.config.credentials import MASK, redact, redact_value
from radard.config.directories import calibration_file, state_dir, status_dirs
from radard.config.sections import path_at_home
from radard.config.sources import ENV_PREFIX
from radard.detect.calibration import load_calibration
from radard.errors import RadardError
from radard.health.heartbeat import read_status, status_path
from radard.judge.bundle import bundle_names, load_bundle
from radard.judge.model_choice import model_for
from x2radar import wall_clock
from x2radar.bounded_yaml import load_yaml
from x2radar.command import Parser, installed_version, new_parser
from x2radar.device.discovery import PortRow, list_ports

_EXAMPLES = """\
examples:
  radard diag                     radard-diag-TIME.tar.gz, in this folder
  radard diag --config /etc/radard/config.yaml --out /tmp/report.tar.gz
  radard diag --add clips/01JD.h5 a recording goes along only if named
  radard diag --list              what would be in it
"""
_ABOUT = """\
A report by radard diag, {when}.

Left out: passwords, tokens, keys, the arguments of programs and paths of webhooks, serial
numbers, the name of the user's folder. No frames and no clips, unless they were added by name.
Look through it before you send it on.

"""
_PACKAGES = (
    *("numpy", "scipy", "pyserial", "pyyaml", "h5py", "onnxruntime", "pydantic", "paho-mqtt"),
    "torch",
)
_VARIABLES = ("STATE_DIRECTORY", "RUNTIME_DIRECTORY", "NOTIFY_SOCKET", "WATCHDOG_USEC", "TZ")
_LIMITS = ("NOFILE", "MEMLOCK", "AS", "CORE", "NPROC", "RTPRIO")
_CGROUP = ("memory.max", "memory.high", "memory.current", "cpu.max", "pids.max")
_WATCHED = ("ModemManager", "brltty", "gpsd", "mosquitto", "radard")
_LAST = 200  # decisions, states and events: some minutes
_MIN_SECRET = 4  # characters: shorter ones would blacken half of the report
_USERINFO = re.compile(r"//[^/@:\s]*:([^/@\s]+)@")


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    when = wall_clock.now()
    parts = gather(args.config)
    if args.list:
        for name, text in parts.items():
            print(f"==== {name}\n{text.rstrip()}\n")
        return 0
    path = args.out or Path(f"radard-diag-{when:%Y%m%dT%H%M%SZ}.tar.gz")
    names = json.dumps([*parts, *(f"added/{file.name}" for file in args.add)], indent=1)
    about = scrub(_ABOUT.format(when=when.isoformat(timespec="seconds")) + names + "\n")
    _write_bundle(path, {"README.txt": about, **parts}, args.add)
    print(path)
    return 0


def make_parser() -> Parser:
    parser = new_parser("radard diag", "Make one redacted file to report trouble with.", _EXAMPLES)
    add = parser.add_argument
    add("--config", type=Path, metavar="FILE", help="configuration file")
    add("--out", type=Path, metavar="FILE", help="file to make (radard-diag-TIME.tar.gz)")
    add("--add", type=Path, action="append", default=[], metavar="FILE", help="a recording")
    add("--list", action="store_true", help="print the parts instead of making a file")
    return parser


def _write_bundle(path: Path, parts: Mapping[str, str], added: Sequence[Path]) -> None:
    """Write parts by name, and added files as they are, into a new `path`; or RadardError."""
    try:
        if len({file.name for file in added}) < len(added):
            raise RadardError("--add: two files of one name; the bundle can hold one of them")
        with path.open("xb") as out, tarfile.open(fileobj=out, mode="w:gz") as tar:
            # Private: what is redacted is still about somebody's home.
            path.chmod(0o600)
            for name, text in parts.items():
                about = tarfile.TarInfo(f"radard-diag/{name}")
                about.size, about.mtime = len(text.encode()), int(wall_clock.now_s())
                tar.addfile(about, io.BytesIO(text.encode()))
            for file in added:
                about = tarfile.TarInfo(f"radard-diag/added/{file.name}")
                about.size, about.mtime = file.stat().st_size, int(file.stat().st_mtime)
                with file.open("rb") as content:
                    tar.addfile(about, content)
    except FileExistsError as err:
        raise RadardError(f"{path}: exists already; reports are never overwritten") from err
    except OSError as err:
        # Half a bundle is none, and would be in the way of the next attempt.
        path.unlink(missing_ok=True)
        raise RadardError(f"{err.filename or path}: {err.strerror or err}") from err


def gather(file: Path | None, environ: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return names and texts of all parts; `file` is the configuration, if one is named."""
    try:
        config, places = load_with_origins(file, environ=environ)
        lines = list(shown(config, places))
    except RadardError as err:
        config, lines = Config(), [f"the configuration is wrong: {err}"]
    makers: dict[str, Callable[[], Any]] = {
        "versions.json": lambda: _versions(config),
        "config.txt": lambda: "\n".join(lines),
        "environment.json": lambda: {
            **{k: redact_value(k, v) for k, v in environ.items() if k.startswith(ENV_PREFIX)},
            **{name: environ[name] for name in _VARIABLES if name in environ},
        },
        "status.json": lambda: _status(config),
        "decisions.txt": lambda: "\n".join(_decisions(config)) or "no store and no json:FILE",
        "ports.json": lambda: [_port(row) for row in list_ports()],
        "limits.json": lambda: _limits(config),
        "calibration.json": lambda: _calibration(config),
    }
    secrets = sorted(_secrets(file, config, environ), key=len, reverse=True)
    return {name: scrub(_tried(make), secrets) + "\n" for name, make in makers.items()}


def scrub(text: str, secrets: Sequence[str] = ()) -> str:
    """Return a text without secrets, known ones and what looks like one, and the user's name."""
    for secret in secrets:
        text = text.replace(secret, MASK)
    # It stays as it is where a user who is a number alone has no home.
    if len(home := str(path_at_home("~"))) > 1:
        text = text.replace(home, "~")
    # Line by line, because a whole line may be an output such as webhook:URL.
    return "\n".join(redact(line) for line in text.split("\n"))


def _tried(make: Callable[[], Any]) -> str:
    try:
        made = make()
    except Exception as err:  # noqa: BLE001 - the other parts matter all the more
        return f"cannot be told: {err!r}"
    return made if isinstance(made, str) else json.dumps(made, indent=1, default=str)


def _versions(config: Config) -> dict[str, Any]:
    found: dict[str, Any] = {
        "radard": installed_version(),
        "python": sys.version,
        "system": platform.platform(),
        "machine": platform.machine(),
        **dict.fromkeys(_PACKAGES),
        "models": list(bundle_names()),
    }
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    try:
        name = model_for(config.model.name)
        found["model"] = "none" if name == "none" else load_bundle(name).name
    except RadardError as err:
        found["model"] = str(err)
    return found


def _status(config: Config) -> dict[str, Any]:
    names = [each.sensor.name for each in config.each()]
    paths = [status_path(folder, name) for folder in status_dirs(config) for name in names]
    reports = {str(path): read_status(path) for path in paths}
    return {path: {"line": each.line, **each.content} for path, each in reports.items()}


def _decisions(config: Config) -> Iterator[str]:
    """Yield the last decisions, states and events that files or stores of this machine hold."""
    for kind, _, name in (output.partition(":") for output in config.output):
        if kind == "json" and name:
            yield f"---- {name}"
            with Path(name).open(encoding="utf-8", errors="replace") as lines:
                yield from (line.rstrip("\n") for line in deque(lines, _LAST))
        elif kind == "store" and name:
            yield f"---- {name}"
            yield from _stored(Path(name))


def _stored(path: Path) -> Iterator[str]:
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as db:
        db.row_factory = sqlite3.Row
        for table in ("events", "statuses", "decisions"):
            last = f"SELECT * FROM {table} ORDER BY rowid DESC LIMIT {_LAST}"  # noqa: S608 - ours
            for row in reversed(db.execute(last).fetchall()):
                yield json.dumps({"table": table, **row})


def _port(row: PortRow) -> dict[str, str]:
    about = asdict(row)
    # A serial number names one thing, and so its owner; the link holds it as well.
    about |= {key: MASK for key in ("serial_number", "by_id") if about[key]}
    if not os.access(row.path, os.F_OK):
        return {**about, "access": "gone"}
    is_open = os.access(row.path, os.R_OK | os.W_OK)
    return {**about, "access": "read and write" if is_open else "denied"}


def _limits(config: Config) -> dict[str, Any]:
    folder = state_dir(config)
    known = next((p for p in (folder, *folder.parents) if p.exists()), Path("/"))
    free_mb = shutil.disk_usage(known).free // 10**6
    codes = ((n, getattr(resource, f"RLIMIT_{n}")) for n in _LIMITS)
    running = {_first_line(each / "comm") for each in Path("/proc").glob("[0-9]*")}
    return {
        **{f"ulimit {n.lower()}": resource.getrlimit(code) for n, code in codes},
        **{f"cgroup {n}": _first_line(Path("/sys/fs/cgroup") / n) or None for n in _CGROUP},
        "cores": len(os.sched_getaffinity(0)),
        "load": os.getloadavg(),
        "memory": _first_line(Path("/proc/meminfo")),
        "state folder": {"path": str(folder), "free_mb": free_mb},
        "root": os.geteuid() == 0,
        "groups": [_group(number) for number in os.getgroups()],
        "programs": sorted(running & set(_WATCHED)),
        "container": Path("/.dockerenv").exists() or Path("/run/.containerenv").exists(),
    }


def _calibration(config: Config) -> dict[str, Any]:
    asked = config.gate.calibration
    path = calibration_file(config) if asked in {"auto", "none"} else Path(asked)
    if not path.is_file():
        return {"asked": asked, "file": f"{path}: is not there"}
    made = load_calibration(path)
    about = asdict(made.provenance)
    return {"asked": asked, "file": str(path), "n_range": len(made.floor), **about}


def _first_line(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig").partition("\n")[0].strip()
    except (OSError, ValueError):
        return ""


def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


def _secrets(file: Path | None, config: Config, environ: Mapping[str, str]) -> set[str]:
    """Return every value that is known to be secret: of the file, the environment, URLs, files."""
    found: set[str] = set()
    path = file or found_file()
    own = {name: value for name, value in environ.items() if name.startswith(ENV_PREFIX)}
    trees: list[Any] = [config.model_dump(mode="json"), own]
    # A file that cannot be read is told of elsewhere.
    with suppress(OSError, ValueError):
        trees.append(load_yaml(path.read_text(encoding="utf-8-sig")) if path else None)
    for key, text in _texts(trees):
        if redact_value(key, text) == MASK:
            found.add(text)
        found.update(_USERINFO.findall(text))
        if key.endswith("_file"):
            found.add(_first_line(Path(text)))
        if key.endswith("_env"):
            found.add(environ.get(text, ""))
    return {text for text in found if len(text) >= _MIN_SECRET}


def _texts(tree: Any, key: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(tree, Mapping):
        for name, value in tree.items():
            yield from _texts(value, str(name))
    elif isinstance(tree, list | tuple):
        for value in tree:
            yield from _texts(value, key)
    elif isinstance(tree, str):
        yield key, tree
