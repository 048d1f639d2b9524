"""`radard setup`: the whole installation, one file of it, or the coverage of a mount.

What was written is recorded in etc/radard/installed.json; uninstalling takes away exactly that.
"""

import argparse
import contextlib
import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel

from radard.commands.setup import files
from radard.commands.setup.coverage import CoverageOptions, coverage_table
from radard.config.options import check_limits
from radard.errors import ConfigError, NotAllowed, RadardError, UsageError
from x2radar.command import Parser, new_parser
from x2radar.errors import MissingExtra
from x2radar.manual import completion, man_page

_EXAMPLES = """\
examples:
  sudo radard setup --install                    user, udev, unit, config, state
  sudo radard setup --install --name attic --port /dev/ttyACM1    one more radar
  sudo radard setup --uninstall                  --purge: with settings and state
  radard setup udev                              print the rule of the port
  sudo radard setup udev --install --usb 0403:6001 --serial A1B2C3
  radard setup systemd --name %i                 print radard@.service
  radard setup coverage --height 2.2 --tilt 20   what a mount would see
"""
_AFTER = {
    "udev": ("udevadm control --reload", "udevadm trigger --subsystem-match=tty"),
    "systemd": ("systemctl daemon-reload", "systemctl enable --now radard"),
    "user": ("systemd-sysusers radard.conf",),
    "config": ("radard config check",),
}
RECORD_FILE = files.CONFIG_FOLDER / "installed.json"
COMMANDS = {"radard": "radard", "x2radar": "x2radar", "train-export": "x2train"}  # by module
_COMPLETIONS = {
    "bash": "usr/local/share/bash-completion/completions/{0}",
    "zsh": "usr/local/share/zsh/site-functions/_{0}",
}
_PACKAGED = Path("usr/lib/systemd/system/radard.service")
_CLOSED_HOMES = ("/home", "/root", "/run/user")  # what ProtectHome= hides (systemd.exec(5))


def run(argv: Sequence[str]) -> int:
    parser = make_parser()
    args = parser.parse_args(argv)
    if args.what is None and args.install == args.uninstall:
        parser.error(f"give --install, --uninstall, or one of {', '.join((*_AFTER, 'coverage'))}")
    if args.uninstall and args.what is None:
        lines = _uninstall(Path(args.root).resolve(), purge=args.purge)
    elif args.what is None:
        lines = _install(Path(args.root).resolve(), args.exec, args.port, args.name)
    elif args.what == "coverage":
        check_limits(args, height=(0.05, 10), tilt=(-90, 90), width=(5, 175))
        check_limits(args, limit=(-40, 80), rcs=(1e-6, 100))
        mount = CoverageOptions(args.height, args.tilt, args.width, args.limit, args.rcs)
        lines = coverage_table(mount)
    else:
        lines = _one(args)
    try:
        for line in lines:
            print(line, flush=True)
    except PermissionError as err:
        raise NotAllowed(f"{err.filename or args.root}: only root may write it; use sudo") from err
    return 0


def _one(args: argparse.Namespace) -> Iterator[str]:
    match args.what:
        case "udev":
            path, text = files.UDEV_FILE, files.udev_rules(args.usb, args.serial)
        case "user":
            path, text = files.USER_FILE, files.shipped("radard.sysusers")
        case "systemd" if args.name:
            path, text = files.INSTANCE_FILE, files.systemd_instance_unit(args.exec)
        case "systemd":
            path, text = files.UNIT_FILE, files.systemd_unit(args.exec, args.port)
        case _:
            path = files.CONFIG_FOLDER / f"{args.name or 'config'}.yaml"
            text = files.first_config(args.name, args.port)
    if not args.install:
        yield text.removesuffix("\n")
        return
    yield from _write(Path(args.root) / path, text)
    yield "now:"
    yield from (f"  {line}" for line in _AFTER[args.what])


def make_parser() -> Parser:
    about = "Install the service and what it needs; print one file; see a mount's coverage."
    parser = new_parser("radard setup", about, _EXAMPLES)
    add = parser.add_argument
    add("--install", action="store_true", help="the whole installation, as root")
    add("--uninstall", action="store_true", help="undo it; settings that were changed stay")
    add("--purge", action="store_true", help="with --uninstall: settings, state and user go too")
    add("--root", default="/", metavar="DIR", help="root of the machine or image (/)")
    own = Path(sys.prefix) / "bin" / "radard"
    add("--exec", type=Path, default=own, metavar="FILE", help="the radard to start (this one)")
    add("--port", default=files.PORT, help=f"as for radard ({files.PORT})")
    add("--name", metavar="NAME", help="one more radar: radard@NAME, /etc/radard/NAME.yaml")
    whats = parser.add_subparsers(dest="what", metavar="udev|systemd|user|config|coverage")
    udev = _sub(whats, "udev", "the rule that names a module /dev/x2radar")
    udev.add_argument("--usb", metavar="VVVV:PPPP", help="an adapter's USB id (x2radar ports)")
    udev.add_argument("--serial", metavar="TEXT", help="and its serial number")
    systemd = _sub(whats, "systemd", "the unit that starts radard with the machine")
    user = _sub(whats, "user", "the user that radard runs as, for systemd-sysusers")
    config = _sub(whats, "config", "a configuration to begin with")
    # What the whole command has as well: given on either side, it holds.
    absent: Any = argparse.SUPPRESS
    systemd.add_argument("--exec", type=Path, default=absent, metavar="FILE", help="(this one)")
    for sub in (systemd, config):
        sub.add_argument("--port", default=absent, help=f"as for radard ({files.PORT})")
        sub.add_argument("--name", default=absent, metavar="NAME", help="that of radard@NAME")
    for sub in (udev, systemd, user, config):
        add = sub.add_argument
        add("--install", action="store_true", default=absent, help="write it, as root")
        add("--root", default=absent, metavar="DIR", help="instead of /")
    coverage = _sub(whats, "coverage", "signal over noise of a body, by height and range")
    add = coverage.add_argument
    add("--height", type=float, metavar="M", help="of the radar over the floor (1.5)")
    add("--tilt", type=float, metavar="DEG", help="down from level (0)")
    add("--width", type=float, metavar="DEG", help="beam, full at half power (65)")
    add("--limit", type=float, metavar="DB", help="least that is seen (10)")
    add("--rcs", type=float, metavar="M2", help="cross section (0.01: a shank)")
    coverage.set_defaults(height=1.5, tilt=0.0, width=65.0, limit=10.0, rcs=0.01)
    return parser


def _sub(subs: "argparse._SubParsersAction[Parser]", name: str, text: str) -> Parser:
    return subs.add_parser(
        name,
        help=text,
        description=f"{'Show' if name == 'coverage' else 'Print or install'} {text}.",
        epilog=f"example:\n  radard setup {name}\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def _is_live(root: Path) -> bool:
    """Return whether this is the machine that runs now, under systemd."""
    return root == Path("/") and Path("/run/systemd/system").is_dir()


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
        try:
            return cls.model_validate_json(path.read_bytes()) if path.exists() else cls()
        except (OSError, ValueError) as err:
            raise ConfigError(f"{path}: is no record of an installation: {err}") from err


def _install(root: Path, program: Path, port: str, name: str | None) -> Iterator[str]:
    """Install all that is not there yet; yield what was done, and what is left to do.

    `program` is as the machine below `root` sees it; `name` is that of radard@NAME.service.
    """
    _check(root, program, port, name)
    record = Record.read(root)
    left: list[str] = []
    texts = {
        files.UDEV_FILE: files.udev_rules(),
        files.UNIT_FILE: files.systemd_unit(program, files.PORT if name else port),
        files.INSTANCE_FILE: files.systemd_instance_unit(program),
        files.FAILED_FILE: files.shipped("radard-failed@.service"),
    }
    if name and (root / files.UNIT_FILE).exists():
        # A second radar must not put the first one's port back.
        del texts[files.UNIT_FILE]
    config = files.CONFIG_FOLDER / f"{name or 'config'}.yaml"
    try:
        yield from _put(root, record, files.USER_FILE, files.shipped("radard.sysusers"))
        yield from _make_user(root, left)
        for path, text in texts.items():
            yield from _put(root, record, path, text)
        if (root / config).exists():
            yield f"{root / config}: stays as it is"
        else:
            yield from _put(root, record, config, files.first_config(name, port))
        yield from _make_state(root, record, name)
        yield from _put_commands(root, record, program)
        yield from _switch_on(root, record, name, left)
    finally:
        with contextlib.suppress(OSError):
            (root / files.CONFIG_FOLDER).mkdir(parents=True, exist_ok=True)
            text = record.model_dump_json(indent=1) + "\n"
            (root / RECORD_FILE).write_text(text, encoding="utf-8")
    if left:
        yield "left to do:"
        yield from (f"  {line}" for line in left)


def _uninstall(root: Path, *, purge: bool) -> Iterator[str]:
    """Take away what `_install` wrote; UsageError if nothing is recorded there."""
    if not (root / RECORD_FILE).exists():
        raise UsageError(f"below {root} is nothing that radard setup --install has made")
    record = Record.read(root)
    is_live = _is_live(root)
    for unit in record.units:
        now = ("--now",) if is_live else ()
        yield from _ran([*_systemctl(root), "disable", *now, unit], needed=False)
    yield from _remove_files(root, record, purge=purge)
    if purge:
        yield from _remove_state(root, record)
    (root / RECORD_FILE).unlink()
    for folder in reversed(record.folders):
        with contextlib.suppress(OSError):  # somebody else's files are in it
            (root / folder).rmdir()
    if is_live:
        yield from _ran(["systemctl", "daemon-reload"], needed=False)
        yield from _ran(["udevadm", "control", "--reload"], needed=False)
    if not purge:
        yield f"{root / files.STATE_FOLDER}, the user radard: kept; --purge takes them away"


def _check(root: Path, program: Path, port: str, name: str | None) -> None:
    if (root / _PACKAGED).exists():
        raise UsageError(f"{root / _PACKAGED}: radard is installed as a package; nothing to do")
    # Refuse them before anything is written.
    files.systemd_unit(program, port)
    files.first_config(name, port)
    here = root / program.relative_to("/")
    if not os.access(here, os.X_OK):
        raise UsageError(f"{here}: no such program; name the radard to start with --exec")
    own = [here.resolve(), Path(sys.executable).resolve()] if root == Path("/") else []
    for path in (program, *own):
        if any(path.is_relative_to(home) for home in _CLOSED_HOMES):
            cure = "install radard below /opt (docs/install.md)"
            raise UsageError(f"{path}: a service does not see home folders; {cure}")


def _put(root: Path, record: Record, path: Path, text: str) -> Iterator[str]:
    """Write a file and record it; one of somebody else's is kept beside it."""
    _make_folder(root, record, path.parent)
    yield from _write(root / path, text, keep=str(path) not in record.files)
    record.files[str(path)] = hashlib.sha256(text.encode()).hexdigest()


def _write(path: Path, text: str, *, keep: bool = True) -> Iterator[str]:
    """Write a file of the system, and yield what was done; an older one is kept beside it."""
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


def _make_folder(root: Path, record: Record, folder: Path, mode: int = 0o755) -> None:
    for each in reversed((folder, *folder.parents)):
        if each.parts and not (root / each).is_dir():
            (root / each).mkdir(mode=mode if each == folder else 0o755)
            record.folders.append(str(each))


def _make_user(root: Path, left: list[str]) -> Iterator[str]:
    if _user_id(root) is not None:
        yield "user radard: is there already"
    elif shutil.which("systemd-sysusers"):
        yield from _ran(["systemd-sysusers", f"--root={root}", "radard.conf"])
    else:
        left.append("systemd-sysusers radard.conf        on the machine itself: makes the user")


def _user_id(root: Path) -> tuple[int, int] | None:
    """Return user and group id of radard on the machine below a root; None without a user."""
    with contextlib.suppress(OSError):
        for line in (root / "etc/passwd").read_text(encoding="utf-8").splitlines():
            name, *parts = line.split(":")
            if name == "radard":
                return int(parts[1]), int(parts[2])
    return None


def _make_state(root: Path, record: Record, name: str | None) -> Iterator[str]:
    folder = files.STATE_FOLDER.with_name(f"radard-{name}" if name else "radard")
    path = root / folder
    if path.is_dir():
        yield f"{path}: is there already"
        return
    _make_folder(root, record, folder, 0o700)
    if (ids := _user_id(root)) and os.geteuid() == 0:
        os.chown(path, *ids)
    yield f"{path}: made"


def _put_commands(root: Path, record: Record, radard: Path) -> Iterator[str]:
    """Put each command that works where shells find it, with its man page and completion."""
    for command, module in COMMANDS.items():
        program = radard.with_name(command)
        try:
            parser: Parser = import_module(f"{module}.cli").whole_parser()
        except (ModuleNotFoundError, SystemExit):
            continue  # for want of an extra
        if not os.access(root / program.relative_to("/"), os.X_OK):
            continue
        page = Path(f"usr/local/share/man/man1/{command}.1")
        yield from _put(root, record, page, man_page(parser))
        for shell, place in _COMPLETIONS.items():
            with contextlib.suppress(MissingExtra):
                script = completion(parser, shell)
                yield from _put(root, record, Path(place.format(command)), script)
        link = Path("usr/local/bin", command)
        if program == Path("/") / link or os.path.lexists(root / link):
            continue
        _make_folder(root, record, link.parent)
        (root / link).symlink_to(program)
        record.links[str(link)] = str(program)
        yield f"{root / link}: link to {program}"


def _switch_on(root: Path, record: Record, name: str | None, left: list[str]) -> Iterator[str]:
    unit = f"radard@{name}.service" if name else files.UNIT_FILE.name
    if unit not in record.units:
        record.units.append(unit)
    if not shutil.which("systemctl"):
        left.append(f"systemctl enable {unit}")
    elif _is_live(root):
        yield from _ran(["udevadm", "control", "--reload"], needed=False)
        yield from _ran(["udevadm", "trigger", "--subsystem-match=tty"], needed=False)
        yield from _ran(["systemctl", "daemon-reload"])
        yield from _ran(["systemctl", "enable", "--now", unit])
    else:
        yield from _ran([*_systemctl(root), "enable", unit])
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


def _remove_files(root: Path, record: Record, *, purge: bool) -> Iterator[str]:
    """Remove links and files, but those that were changed; yield what became of each."""
    links = ((root / name, target) for name, target in record.links.items())
    ours = [path for path, to in links if path.is_symlink() and str(path.readlink()) == to]
    for name, digest in record.files.items():
        if (path := root / name).is_file():
            if purge or hashlib.sha256(path.read_bytes()).hexdigest() == digest:
                ours.append(path)
            else:
                yield f"{path}: kept, because it was changed since; --purge takes it away"
    for path in ours:
        path.unlink()
        yield f"{path}: removed"


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
