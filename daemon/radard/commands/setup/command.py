"""`radard setup`: the whole installation, one file of it, or the coverage of a mount."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from radard.commands.setup import files
from radard.commands.setup.coverage import CoverageOptions, coverage_table
from radard.commands.setup.system import Installation, install_system, uninstall_system, write_file
from x2radar.command import Parser, new_parser

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


def run(argv: Sequence[str]) -> int:
    parser = make_parser()
    args = parser.parse_args(argv)
    if args.what is None and args.install == args.uninstall:
        parser.error(f"give --install, --uninstall, or one of {', '.join((*_AFTER, 'coverage'))}")
    if args.what is None:
        lines = _whole(args)
    elif args.what == "coverage":
        mount = CoverageOptions(**{f.name: getattr(args, f.name) for f in fields(CoverageOptions)})
        lines = iter(coverage_table(mount))
    else:
        lines = _one(args, *_file_of(args))
    for line in lines:
        print(line, flush=True)
    return 0


def _whole(args: argparse.Namespace) -> Iterator[str]:
    root = Path(args.root).resolve()
    if args.uninstall:
        return uninstall_system(root, purge=args.purge)
    return install_system(Installation(root, args.exec, args.port, args.name))


def _file_of(args: argparse.Namespace) -> tuple[Path, str]:
    match args.what:
        case "udev":
            return files.UDEV_FILE, files.udev_rules(args.usb, args.serial)
        case "user":
            return files.USER_FILE, files.shipped("radard.sysusers")
        case "systemd" if args.name:
            return files.INSTANCE_FILE, files.systemd_instance_unit(args.exec)
        case "systemd":
            return files.UNIT_FILE, files.systemd_unit(args.exec, args.port)
        case _:
            path = files.CONFIG_FOLDER / f"{args.name or 'config'}.yaml"
            return path, files.first_config(args.name, args.port)


def _one(args: argparse.Namespace, path: Path, text: str) -> Iterator[str]:
    if not args.install:
        yield text.removesuffix("\n")
        return
    yield from write_file(Path(args.root) / path, text)
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
    for f in fields(CoverageOptions):
        told = {"default": f.default, "metavar": f.metadata["unit"], "help": f.metadata["help"]}
        coverage.add_argument(f.metadata["option"], dest=f.name, type=float, **told)
    return parser


def _sub(subs: "argparse._SubParsersAction[Parser]", name: str, text: str) -> Parser:
    return subs.add_parser(
        name,
        help=text,
        description=f"{'Show' if name == 'coverage' else 'Print or install'} {text}.",
        epilog=f"example:\n  radard setup {name}\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
