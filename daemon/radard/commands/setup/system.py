"""`radard setup --install` and `--uninstall`: a whole installation on a machine, and its end.

What was written is recorded in etc/radard/installed.json: each file with its SHA-256, each link
and each folder that was not there. Uninstalling takes away exactly that; a file that was changed
since stays, unless all is to go.
"""

import contextlib
import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel

from radard.commands.setup import files
from radard.errors import ConfigError, NotAllowed, RadardError, UsageError
from x2radar.command import Parser
from x2radar.errors import MissingExtra
from x2radar.manual import completion, man_page

RECORD_FILE = files.CONFIG_FOLDER / "installed.json"
COMMANDS = {"radard": "radard", "x2radar": "x2radar", "train-export": "x2train"}
"""The commands and the module behind each."""
_COMPLETIONS = {
    "bash": "usr/local/share/bash-completion/completions/{0}",
    "zsh": "usr/local/share/zsh/site-functions/_{0}",
}
_PACKAGED = Path("usr/lib/systemd/system/radard.service")
_CLOSED_HOMES = ("/home", "/root", "/run/user")  # what ProtectHome= hides (systemd.exec(5))


@dataclass(frozen=True, slots=True)
class Installation:
    """What is to be installed, and where."""

    root: Path  # the machine's root folder; another one is an image's
    program: Path  # the `radard` to start, as the machine itself sees it
    port: str = files.PORT
    name: str | None = None  # of radard@NAME.service; None for radard.service

    @property
    def is_live(self) -> bool:
        """Whether this is the machine that runs now, under systemd."""
        return self.root == Path("/") and Path("/run/systemd/system").is_dir()


def _check_below(name: str) -> str:
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise ValueError("leaves the root folder")
    return name


Below = Annotated[str, AfterValidator(_check_below)]  # a path below the root


class Record(BaseModel, extra="forbid"):
    """What an installation has written, below its root."""

    files: dict[Below, str] = {}  # SHA-256 of each file as it was written
    links: dict[Below, str] = {}  # target of each link
    folders: list[Below] = []  # made by us, outer before inner
    units: list[str] = []  # switched on

    @classmethod
    def read(cls, root: Path) -> "Record":
        """Return what is recorded below a root, empty if nothing is; ConfigError if damaged."""
        path = root / RECORD_FILE
        if not path.exists():
            return cls()
        try:
            return cls.model_validate_json(path.read_bytes())
        except (OSError, ValueError) as err:
            raise ConfigError(f"{path}: is no record of an installation: {err}") from err

    def write(self, root: Path) -> None:
        """Keep it for the uninstallation."""
        path = root / RECORD_FILE
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.model_dump_json(indent=1) + "\n", encoding="utf-8")


def install_system(what: Installation) -> Iterator[str]:
    """Install all that is not there yet; yield what was done, and what is left to do."""
    _check(what)
    record = Record.read(what.root)
    left: list[str] = []
    try:
        with _refusals(what.root):
            yield from _put(what, record, files.USER_FILE, files.shipped("radard.sysusers"))
            yield from _make_user(what, left)
            yield from _put(what, record, files.UDEV_FILE, files.udev_rules())
            yield from _put_units(what, record)
            yield from _put_config(what, record)
            yield from _make_state(what, record)
            yield from _put_commands(what, record)
            yield from _switch_on(what, record, left)
    finally:
        with contextlib.suppress(OSError):
            record.write(what.root)
    if left:
        yield "left to do:"
        yield from (f"  {line}" for line in left)


def uninstall_system(root: Path, *, purge: bool) -> Iterator[str]:
    """Take away what `install_system` wrote; UsageError if nothing is recorded there."""
    if not (root / RECORD_FILE).exists():
        msg = f"{root / RECORD_FILE}: not there: nothing that radard setup --install has made"
        raise UsageError(msg)
    record = Record.read(root)
    is_live = Installation(root, files.own_program()).is_live
    with _refusals(root):
        for unit in record.units:
            now = ("--now",) if is_live else ()
            yield from _ran([*_systemctl(root), "disable", *now, unit], needed=False)
        kept = yield from _remove_files(root, record, purge=purge)
        if purge:
            yield from _remove_state(root, record)
        (root / RECORD_FILE).unlink()
        for folder in reversed(record.folders):
            with contextlib.suppress(OSError):  # somebody else's files are in it
                (root / folder).rmdir()
        if is_live:
            yield from _ran(["systemctl", "daemon-reload"], needed=False)
            yield from _ran(["udevadm", "control", "--reload"], needed=False)
    for path in kept:
        yield f"{path}: kept, because it was changed since; --purge takes it away"
    if not purge:
        yield f"{root / files.STATE_FOLDER}, the user radard: kept; --purge takes them away"


def _check(what: Installation) -> None:
    if (what.root / _PACKAGED).exists():
        msg = f"{what.root / _PACKAGED}: radard is installed as a package; nothing is left to do"
        raise UsageError(msg)
    # Refuse them before anything is written.
    files.systemd_unit(what.program, what.port)
    files.first_config(what.name, what.port)
    program = _below(what.root, what.program)
    if not os.access(program, os.X_OK):
        raise UsageError(f"{program}: no such program; name the radard to start with --exec")
    seen = [str(what.program)]
    if what.root == Path("/"):
        seen += [str(program.resolve()), str(Path(sys.executable).resolve())]
    for path in seen:
        if path.startswith(tuple(f"{home}/" for home in _CLOSED_HOMES)):
            msg = f"{path}: a service does not see home folders; install radard below /opt "
            msg += "(docs/install.md)"
            raise UsageError(msg)


def _below(root: Path, path: Path) -> Path:
    return root / path.relative_to("/")


def _put_units(what: Installation, record: Record) -> Iterator[str]:
    unit = files.systemd_unit(what.program, files.PORT if what.name else what.port)
    # A second radar must not put the first one's port back.
    if not (what.name and (what.root / files.UNIT_FILE).exists()):
        yield from _put(what, record, files.UNIT_FILE, unit)
    text = files.systemd_instance_unit(what.program)
    yield from _put(what, record, files.INSTANCE_FILE, text)
    text = files.shipped("radard-failed@.service")
    yield from _put(what, record, files.FAILED_FILE, text)


def _put_config(what: Installation, record: Record) -> Iterator[str]:
    path = files.CONFIG_FOLDER / f"{what.name or 'config'}.yaml"
    if (what.root / path).exists():
        yield f"{what.root / path}: stays as it is"
    else:
        yield from _put(what, record, path, files.first_config(what.name, what.port))


def _put(what: Installation, record: Record, path: Path, text: str) -> Iterator[str]:
    """Write a file and record it; one of somebody else's is kept beside it."""
    _make_folder(what.root, record, path.parent)
    is_ours = str(path) in record.files
    yield from write_file(what.root / path, text, keep=not is_ours)
    record.files[str(path)] = _sha256(text.encode())


def write_file(path: Path, text: str, *, keep: bool = True) -> Iterator[str]:
    """Write a file of the system, and yield what was done; an older one is kept beside it."""
    with _refusals(path):
        old = path.read_text(encoding="utf-8") if path.exists() else None
        if old == text:
            yield f"{path}: is there already"
            return
        if old is not None and keep:
            kept = path.with_name(path.name + ".old")
            path.replace(kept)
            yield f"{kept}: the file that was there"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        path.chmod(0o644)
    yield f"{path}: written"


@contextlib.contextmanager
def _refusals(path: Path) -> Iterator[None]:
    try:
        yield
    except PermissionError as err:
        raise NotAllowed(f"{err.filename or path}: only root may write it; use sudo") from err
    except OSError as err:
        msg = f"{err.filename or path}: cannot be written: {err.strerror or err}"
        raise RadardError(msg) from err


def _make_folder(root: Path, record: Record, folder: Path, mode: int = 0o755) -> None:
    for each in reversed((folder, *folder.parents)):
        if each.parts and not (root / each).is_dir():
            (root / each).mkdir(mode=mode if each == folder else 0o755)
            record.folders.append(str(each))


def _make_user(what: Installation, left: list[str]) -> Iterator[str]:
    if _user_id(what.root) is not None:
        yield "user radard: is there already"
        return
    if shutil.which("systemd-sysusers"):
        yield from _ran(["systemd-sysusers", f"--root={what.root}", "radard.conf"])
    else:
        left.append("systemd-sysusers radard.conf        on the machine itself: makes the user")


def _user_id(root: Path) -> tuple[int, int] | None:
    """Return user and group id of radard on the machine below a root; None without a user."""
    try:
        lines = (root / "etc/passwd").read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    for line in lines:
        parts = line.split(":")
        if parts[0] == "radard":
            return int(parts[2]), int(parts[3])
    return None


def _make_state(what: Installation, record: Record) -> Iterator[str]:
    folder = files.STATE_FOLDER
    if what.name:
        folder = folder.with_name(f"radard-{what.name}")
    if (what.root / folder).is_dir():
        yield f"{what.root / folder}: is there already"
        return
    _make_folder(what.root, record, folder, 0o700)
    ids = _user_id(what.root)
    if ids is not None and os.geteuid() == 0:
        os.chown(what.root / folder, *ids)
    yield f"{what.root / folder}: made"


def _put_commands(what: Installation, record: Record) -> Iterator[str]:
    """Put each command that works where shells find it, with its man page and completion."""
    for command, module in COMMANDS.items():
        parser = _parser_of(module)
        program = what.program.with_name(command)
        if parser is None or not os.access(_below(what.root, program), os.X_OK):
            continue
        page = man_page(parser)
        yield from _put(what, record, Path(f"usr/local/share/man/man1/{command}.1"), page)
        for shell, place in _COMPLETIONS.items():
            with contextlib.suppress(MissingExtra):
                script = completion(parser, shell)
                yield from _put(what, record, Path(place.format(command)), script)
        link = Path("usr/local/bin", command)
        if program == Path("/") / link or os.path.lexists(what.root / link):
            continue
        _make_folder(what.root, record, link.parent)
        (what.root / link).symlink_to(program)
        record.links[str(link)] = str(program)
        yield f"{what.root / link}: link to {program}"


def _parser_of(module: str) -> Parser | None:
    """Return the whole parser of a command; None where it cannot run, for want of an extra."""
    try:
        parser: Parser = import_module(f"{module}.cli").whole_parser()
    except (ModuleNotFoundError, SystemExit):
        return None
    return parser


def _switch_on(what: Installation, record: Record, left: list[str]) -> Iterator[str]:
    unit = f"radard@{what.name}.service" if what.name else files.UNIT_FILE.name
    if unit not in record.units:
        record.units.append(unit)
    if not shutil.which("systemctl"):
        left.append(f"systemctl enable {unit}")
        return
    if what.is_live:
        yield from _ran(["udevadm", "control", "--reload"], needed=False)
        yield from _ran(["udevadm", "trigger", "--subsystem-match=tty"], needed=False)
        yield from _ran(["systemctl", "daemon-reload"])
        yield from _ran(["systemctl", "enable", "--now", unit])
    else:
        yield from _ran([*_systemctl(what.root), "enable", unit])
        left.append(f"start the machine, or: systemctl daemon-reload; systemctl start {unit}")


def _systemctl(root: Path) -> list[str]:
    return ["systemctl"] if root == Path("/") else ["systemctl", f"--root={root}"]


def _ran(argv: Sequence[str], *, needed: bool = True) -> Iterator[str]:
    """Run a command of the system; raises RadardError if one that is needed fails."""
    if shutil.which(argv[0]) is None and not needed:
        return
    done = subprocess.run(argv, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    line = " ".join(argv)
    if done.returncode != 0 and needed:
        msg = f"{line}: {' '.join(done.stderr.split()) or f'exit code {done.returncode}'}"
        raise RadardError(msg)
    yield f"ran: {line}" + ("" if done.returncode == 0 else " (failed)")


def _remove_files(root: Path, record: Record, *, purge: bool) -> Any:
    """Remove files and links, yielding each; return those that stay."""
    kept = []
    for name, target in record.links.items():
        path = root / name
        if path.is_symlink() and str(path.readlink()) == target:
            path.unlink()
            yield f"{path}: removed"
    for name, digest in record.files.items():
        path = root / name
        if not path.is_file():
            continue
        if _sha256(path.read_bytes()) != digest and not purge:
            kept.append(path)
            continue
        path.unlink()
        yield f"{path}: removed"
    return kept


def _remove_state(root: Path, record: Record) -> Iterator[str]:
    names = [unit.partition("@")[2].removesuffix(".service") for unit in record.units]
    for name in ["radard", *(f"radard-{name}" for name in names if name)]:
        folder = root / files.STATE_FOLDER.with_name(name)
        if folder.is_dir():
            shutil.rmtree(folder)
            yield f"{folder}: removed"
    if _user_id(root) is not None:
        where = () if root == Path("/") else ("--prefix", str(root))
        yield from _ran(["userdel", *where, "radard"], needed=False)


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
