"""The parts of a report of trouble, each a text, all of them without secrets."""

import grp
import json
import os
import platform
import re
import resource
import shutil
import sqlite3
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from radard.commands.config import shown
from radard.config.config import DEFAULT_FILES, Config, Loaded, load_with_origins
from radard.config.directories import calibration_file, state_dir, status_dirs
from radard.config.redact import MASK, redact, redact_value
from radard.config.sources import ENV_PREFIX
from radard.detect.calibration import load_calibration
from radard.errors import RadardError
from radard.health.status_file import read_status, status_path
from radard.judge.bundle import bundle_names, load_bundle
from radard.judge.model_choice import model_for
from x2radar.bounded_yaml import load_yaml
from x2radar.command import installed_version
from x2radar.device.discovery import list_ports

_PACKAGES = (
    *("numpy", "scipy", "pyserial", "pyyaml", "h5py", "onnxruntime", "pydantic", "paho-mqtt"),
    "torch",
)
_LIMITS = ("NOFILE", "MEMLOCK", "AS", "CORE", "NPROC", "RTPRIO")
_CGROUP = ("memory.max", "memory.high", "memory.current", "cpu.max", "pids.max")
_WATCHED = ("ModemManager", "brltty", "gpsd", "mosquitto", "radard")
_LAST = 200  # decisions, states and events: some minutes
_MIN_SECRET = 4  # characters: shorter ones would blacken half of the report
_USERINFO = re.compile(r"//[^/@:\s]*:([^/@\s]+)@")


@dataclass(frozen=True, slots=True)
class Scrubber:
    """Takes secrets out of any text: those that are known, and what looks like one."""

    secrets: tuple[str, ...]

    def scrub(self, text: str) -> str:
        """Return the text without them, and without the user's name in paths."""
        for secret in self.secrets:
            text = text.replace(secret, MASK)
        # A user who is a number alone has none.
        with suppress(RuntimeError):
            if len(home := str(Path.home())) > 1:
                text = text.replace(home, "~")
        # Line by line, because a whole line may be an output such as webhook:URL.
        return "\n".join(redact(line) for line in text.split("\n"))


def gather(file: Path | None, environ: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return names and texts of all parts; `file` is the configuration, if one is named."""
    loaded: Loaded | None = None
    fault = ""
    try:
        loaded = load_with_origins(file, environ=environ)
    except RadardError as err:
        fault = f"the configuration is wrong: {err}"
    config = loaded.config if loaded else Config()
    lines = list(shown(loaded)) if loaded else [fault]
    makers: dict[str, Callable[[], str]] = {
        "versions.json": lambda: _json(_versions(config)),
        "config.txt": lambda: "\n".join(lines),
        "environment.json": lambda: _json(_environment(environ)),
        "status.json": lambda: _json(_status(config)),
        "decisions.txt": lambda: "\n".join(_decisions(config)) or "no store and no json:FILE",
        "ports.json": lambda: _json(list(_ports())),
        "limits.json": lambda: _json(_limits(config)),
        "calibration.json": lambda: _json(_calibration(config)),
    }
    scrubber = Scrubber(tuple(sorted(_secrets(file, config, environ), key=len, reverse=True)))
    return {name: scrubber.scrub(_tried(make)) + "\n" for name, make in makers.items()}


def _tried(make: Callable[[], str]) -> str:
    try:
        return make()
    except Exception as err:  # noqa: BLE001 - the other parts matter all the more
        return f"cannot be told: {err!r}"


def _json(content: Any) -> str:
    return json.dumps(content, indent=1, default=str)


def _versions(config: Config) -> dict[str, Any]:
    found: dict[str, Any] = {
        "radard": installed_version(),
        "python": sys.version,
        "system": platform.platform(),
        "machine": platform.machine(),
    }
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    found["models"] = list(bundle_names())
    try:
        name = model_for(config.model.name)
        found["model"] = "none" if name == "none" else load_bundle(name).name
    except RadardError as err:
        found["model"] = str(err)
    return found


def _environment(environ: Mapping[str, str]) -> dict[str, Any]:
    names = (*("STATE_DIRECTORY", "RUNTIME_DIRECTORY", "NOTIFY_SOCKET"), "WATCHDOG_USEC", "TZ")
    own = {k: redact_value(k, v) for k, v in environ.items() if k.startswith(ENV_PREFIX)}
    return {**own, **{name: environ[name] for name in names if name in environ}}


def _status(config: Config) -> dict[str, Any]:
    reports = {}
    for folder in status_dirs(config):
        for each in config.each():
            path = status_path(folder, each.sensor.name)
            report = read_status(path)
            reports[str(path)] = {"line": report.line, **report.content}
    return reports


def _decisions(config: Config) -> Iterator[str]:
    """Yield the last decisions, states and events that files or stores of this machine hold."""
    for output in config.output:
        kind, _, name = output.partition(":")
        if kind == "json" and name:
            yield f"---- {name}"
            with Path(name).open(encoding="utf-8", errors="replace") as lines:
                yield from (line.rstrip("\n") for line in deque(lines, _LAST))
        elif kind == "store" and name:
            yield f"---- {name}"
            yield from _stored(Path(name))


def _stored(path: Path) -> Iterator[str]:
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as db:
        for table in ("events", "statuses", "decisions"):
            cursor = db.execute(
                f"SELECT * FROM {table} ORDER BY rowid DESC LIMIT ?",  # noqa: S608 - our own names
                (_LAST,),
            )
            names = [column[0] for column in cursor.description]
            for row in reversed(cursor.fetchall()):
                yield json.dumps({"table": table, **dict(zip(names, row, strict=True))})


def _ports() -> Iterator[dict[str, str]]:
    for row in list_ports():
        about = asdict(row)
        # A serial number names one thing, and so its owner; the link holds it as well.
        for key in ("serial_number", "by_id"):
            about[key] = MASK if about[key] else ""
        yield {**about, "access": _access(row.path)}


def _access(path: str) -> str:
    if not os.access(path, os.F_OK):
        return "gone"
    return "read and write" if os.access(path, os.R_OK | os.W_OK) else "denied"


def _limits(config: Config) -> dict[str, Any]:
    found: dict[str, Any] = {
        f"ulimit {name.lower()}": resource.getrlimit(getattr(resource, f"RLIMIT_{name}"))
        for name in _LIMITS
    }
    for name in _CGROUP:
        found[f"cgroup {name}"] = _first_line(Path("/sys/fs/cgroup") / name)
    folder = state_dir(config)
    known = next((p for p in (folder, *folder.parents) if p.exists()), Path("/"))
    found["cores"] = len(os.sched_getaffinity(0))
    found["load"] = os.getloadavg()
    found["memory"] = _first_line(Path("/proc/meminfo"))
    free_mb = shutil.disk_usage(known).free // 10**6
    found["state folder"] = {"path": str(folder), "free_mb": free_mb}
    found["root"] = os.geteuid() == 0
    found["groups"] = [_group(number) for number in os.getgroups()]
    found["programs"] = sorted(set(_running()) & set(_WATCHED))
    found["container"] = Path("/.dockerenv").exists() or Path("/run/.containerenv").exists()
    return found


def _calibration(config: Config) -> dict[str, Any]:
    asked = config.gate.calibration
    path = calibration_file(config) if asked in {"auto", "none"} else Path(asked)
    if not path.is_file():
        return {"asked": asked, "file": f"{path}: is not there"}
    made = load_calibration(path)
    about = asdict(made.provenance)
    return {"asked": asked, "file": str(path), "n_range": len(made.floor), **about}


def _first_line(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8").partition("\n")[0]
    except OSError:
        return None


def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


def _running() -> Iterator[str]:
    for folder in Path("/proc").glob("[0-9]*"):
        name = _first_line(folder / "comm")
        if name:
            yield name


def _secrets(file: Path | None, config: Config, environ: Mapping[str, str]) -> set[str]:
    """Return every value that is known to be secret: of the file, the environment, URLs, files."""
    found: set[str] = set()
    path = file or next((p for p in DEFAULT_FILES if p.is_file()), None)
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
            found.add((_first_line(Path(text)) or "").strip())
        if key.endswith("_env"):
            found.add(environ.get(text, ""))
    return {text for text in found if len(text) >= _MIN_SECRET}


def _texts(tree: Any, key: str = "") -> Iterable[tuple[str, str]]:
    if isinstance(tree, Mapping):
        for name, value in tree.items():
            yield from _texts(value, str(name))
    elif isinstance(tree, list | tuple):
        for value in tree:
            yield from _texts(value, key)
    elif isinstance(tree, str):
        yield key, tree
