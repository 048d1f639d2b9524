"""Folders of the daemon: state that must outlive it, and the status of this moment.

systemd names both (StateDirectory=, RuntimeDirectory=); run by hand, they are the user's own.
"""

import atexit
import contextlib
import fcntl
import logging
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from radard.config.saved import Kind
from radard.config.sections import path_at_home
from radard.errors import ConfigError, NotAllowed
from x2radar.ports import parse_port

if TYPE_CHECKING:
    from radard.config.config import Config

SYSTEM_RUNTIME_DIR = Path("/run/radard")  # RuntimeDirectory= of the unit in deploy/systemd
SYSTEM_STATE_DIR = Path("/var/lib/radard")  # StateDirectory= of the same
log = logging.getLogger("radard")
Environ = Mapping[str, str]
_OTHER = "another radard uses this state directory"
_held: dict[Path, int] = {}  # folders that this process has locked


def named_state_dir(config: "Config", environ: Environ = os.environ) -> Path | None:
    """Return the folder that configuration or systemd names for state, if any."""
    given = environ.get("STATE_DIRECTORY", "").partition(":")[0]
    return config.service.state_dir or (Path(given) if given else None)


def state_dir(config: "Config", environ: Environ = os.environ) -> Path:
    """Return the folder of what outlives a restart; ConfigError if others could write it."""
    if (folder := named_state_dir(config, environ)) is not None:
        return folder
    # A relative one is void (XDG Base Directory Specification).
    if (home := Path(environ.get("XDG_STATE_HOME", ""))).is_absolute():
        return home / "radard"
    if (home := path_at_home("~")).is_absolute():
        return home / ".local" / "state" / "radard"
    if (folder := _temporary_dir()) is not None:
        return folder / "state"
    raise ConfigError("there is no home folder to keep state in: name one in service.state_dir")


@cache
def own_folder() -> Path:
    """Return the folder of what simulated and replayed sensors are told in this process."""
    try:
        among = Path(tempfile.gettempdir())
    except OSError:
        among = Path("/tmp")  # noqa: S108 - nobody can write there or elsewhere, and who tries says so
    # Made by the first who writes there, and by nobody else: its name cannot be guessed.
    folder = among / f"radard-{secrets.token_hex(12)}"
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def saved_file(
    config: "Config", kind: Kind, environ: Environ = os.environ, *, port: str | None = None
) -> Path:
    """Return where the dashboard keeps the sensor's 'zones' or 'settings'."""
    sensor = config.sensor
    if (parse_port(port).kind if port else sensor.kind) in {"sim", "replay"}:
        folder = named_state_dir(config, environ) or own_folder()
        return folder / f"{sensor.name}.sim.{kind}.yaml"
    return state_dir(config, environ) / f"{sensor.name}.{kind}.yaml"


def calibration_file(config: "Config") -> Path:
    """Return where the calibration of the sensor's room is kept."""
    return state_dir(config) / f"{config.sensor.name}.calibration.json"


def for_service(config: "Config", own: Path) -> Path:
    """Return where a command keeps state: the service's, if installed; or NotAllowed."""
    # Not is_dir(): for anybody but root it may be a link into a folder that is closed.
    if named_state_dir(config) is not None or not os.path.lexists(SYSTEM_STATE_DIR):
        return own
    if not os.access(SYSTEM_STATE_DIR, os.W_OK | os.X_OK):
        raise NotAllowed(f"{SYSTEM_STATE_DIR}: the service keeps its {own.name} there: use sudo")
    return SYSTEM_STATE_DIR / own.name


def kept_calibration(config: "Config") -> Path:
    """Return where a running sensor keeps the calibration that it makes."""
    if config.gate.calibration not in {"auto", "none"}:
        return Path(config.gate.calibration)
    if config.sensor.kind != "sim":
        return calibration_file(config)
    folder = named_state_dir(config) or own_folder()
    return folder / f"{config.sensor.name}.sim.calibration.json"


def clip_dir(config: "Config", environ: Environ = os.environ) -> Path | None:
    """Return the folder of a sensor's clips; None when there shall be none."""
    if not config.clips.enabled:
        return None
    named = named_state_dir(config, environ)
    folder = config.clips.dir or (named / "clips" if named is not None else None)
    return folder / config.sensor.name if folder and config.is_one_of_several else folder


def log_path(config: "Config", environ: Environ = os.environ) -> Path | None:
    """Return the file of the event log; None with replays, or a sensor simulated by hand."""
    kinds = {each.sensor.kind for each in config.each()}
    if kinds == {"replay"}:
        return None
    by_hand = kinds & {"sim", "replay"}
    folder = named_state_dir(config, environ) if by_hand else state_dir(config, environ)
    return folder / "log.db" if folder is not None else None


def status_dirs(config: "Config", environ: Environ = os.environ) -> tuple[Path, ...]:
    """Return where a status file may lie, as seen by another user than the daemon's."""
    own = runtime_dir(config, environ)
    is_named = config.service.runtime_dir is not None or "RUNTIME_DIRECTORY" in environ
    return (own,) if is_named else (SYSTEM_RUNTIME_DIR, own)


def runtime_dir(config: "Config", environ: Environ = os.environ) -> Path:
    """Return the folder of the status file, to which nobody else may write."""
    given = config.service.runtime_dir or environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given)
    if (own := Path(environ.get("XDG_RUNTIME_DIR", ""))).is_absolute():
        return own / "radard"
    return _temporary_dir() or state_dir(config, environ) / "run"


def demo_state(config: "Config", environ: Environ = os.environ) -> "Config":
    """Return the configuration, with a passing state folder if only simulations are shown."""
    is_sim = {each.sensor.kind for each in config.each()} == {"sim"}
    has_page = any(output.startswith("http:") for output in config.output)
    if not (is_sim and has_page) or named_state_dir(config, environ) is not None:
        return config
    service = config.service.model_copy(update={"state_dir": own_folder()})
    return config.model_copy(update={"service": service})


def _temporary_dir() -> Path | None:
    """Return radard-UID among the temporary files; None unless it is private to the user."""
    try:
        folder = Path(tempfile.gettempdir()) / f"radard-{os.getuid()}"
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        found = folder.lstat()
    except OSError:
        return None
    is_own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
    return folder if is_own and not found.st_mode & 0o077 else None


@contextlib.contextmanager
def state_lock(config: "Config", environ: Environ = os.environ) -> Iterator[None]:
    """Hold the state directory, if one is used; ConfigError while another daemon does."""
    path = log_path(config, environ)
    if path is None:
        yield
        return
    folder = path.parent
    try:
        _held[folder] = _locked(folder)
    except BlockingIOError as err:
        msg = f"{folder}: {_OTHER}; stop it, or name another folder in service.state_dir "
        raise ConfigError(f"{msg}(RADARD_SERVICE__STATE_DIR)") from err
    except OSError as err:
        log.warning("%s: not locked against a second radard: %s", folder, err.strerror or err)
    try:
        yield
    finally:
        if (fd := _held.pop(folder, None)) is not None:
            os.close(fd)


def lock_again(folder: Path) -> None:
    """Lock a folder that was made again since `state_lock`; OSError while another daemon does."""
    if (fd := _held.get(folder)) is None:
        return
    with contextlib.suppress(OSError):
        if os.path.samestat(os.fstat(fd), folder.stat()):
            return
    try:
        _held[folder] = _locked(folder)
    except BlockingIOError as err:
        raise OSError(err.errno, _OTHER) from err
    os.close(fd)


def _locked(folder: Path) -> int:
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(fd)
        raise
    return fd
