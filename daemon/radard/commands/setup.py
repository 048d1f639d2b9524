"""`radard setup`: the system's files for the radar, printed or installed, and its coverage."""

import argparse
import re
import sys
from collections.abc import Iterator, Sequence
from importlib import resources
from pathlib import Path

from radard.commands.coverage import CoverageOptions, coverage_table
from radard.errors import NotAllowed, RadardError, UsageError
from x2radar.command import Parser, new_parser

_EXAMPLES = """\
examples:
  radard setup udev                              print the rule of the port
  sudo radard setup udev --install
  sudo radard setup udev --install --usb 0403:6001 --serial A1B2C3
  sudo radard setup systemd --install --port /dev/x2radar
  radard setup coverage --height 2.2 --tilt 20   what a mount would see
"""
UDEV_FILE = Path("etc/udev/rules.d/60-x2radar.rules")
UNIT_FILE = Path("etc/systemd/system/radard.service")
_CONFIG = "/etc/radard/config.yaml"
_USB_ID = re.compile(r"[0-9a-f]{4}:[0-9a-f]{4}")
_SERIAL = re.compile(r"[A-Za-z0-9._-]{1,64}")
_AFTER = {
    "udev": ("udevadm control --reload", "udevadm trigger --subsystem-match=tty"),
    "systemd": ("systemctl daemon-reload", "systemctl enable --now radard"),
}


def run(argv: Sequence[str]) -> int:
    """Run the subcommand."""
    args = _parser().parse_args(argv)
    if args.what == "coverage":
        options = CoverageOptions(
            height_m=args.height,
            tilt_deg=args.tilt,
            width_deg=args.width,
            limit_db=args.limit,
            rcs_m2=args.rcs,
        )
        print("\n".join(coverage_table(options)))
        return 0
    is_udev = args.what == "udev"
    text = udev_rules(args.usb, args.serial) if is_udev else systemd_unit(args.exec, args.port)
    if not args.install:
        print(text, end="")
        return 0
    path = args.root / (UDEV_FILE if is_udev else UNIT_FILE)
    for line in install(path, text):
        print(line)
    print("now:", *_AFTER[args.what], sep="\n  ")
    return 0


def udev_rules(usb_id: str | None = None, serial: str | None = None) -> str:
    """Return the udev rules; with an adapter's USB id and serial number, for it as well."""
    text = _shipped("60-x2radar.rules")
    if usb_id is None and serial is None:
        return text
    if usb_id is None or serial is None:
        msg = "--usb and --serial belong together: adapters of one kind carry other things too"
        raise UsageError(msg)
    if not _USB_ID.fullmatch(usb_id.lower()):
        msg = f"--usb '{usb_id}': must be two hexadecimal numbers, as in 0403:6001"
        raise UsageError(msg)
    if not _SERIAL.fullmatch(serial):
        msg = f"--serial '{serial}': must be letters, digits and . _ - only"
        raise UsageError(msg)
    vendor, product = usb_id.lower().split(":")
    rule = (
        f'ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}", '
        f'ATTRS{{serial}}=="{serial}", ENV{{X2RADAR}}="1"\n'
    )
    mark = "# Common adapters"
    return text.replace(mark, f"# The adapter that was named.\n{rule}\n{mark}", 1)


def systemd_unit(program: Path | None = None, port: str = "/dev/x2radar") -> str:
    """Return the systemd unit for a program and a port."""
    program = program or Path(sys.prefix) / "bin" / "radard"
    if not program.is_absolute():
        msg = f"--exec '{program}': must be a whole path, as systemd wants it"
        raise UsageError(msg)
    words = (str(program), "--port", port, "--wait", "--config", _CONFIG)
    line = "ExecStart=" + " ".join(_unit_word(word) for word in words)
    text = _shipped("radard.service")
    return re.sub(r"^ExecStart=.*$", lambda _: line, text, count=1, flags=re.MULTILINE)


def install(path: Path, text: str) -> Iterator[str]:
    """Write a file of the system, and yield what was done; an older one is kept beside it."""
    try:
        old = path.read_text(encoding="utf-8") if path.exists() else None
        if old == text:
            yield f"{path}: is there already"
            return
        if old is not None:
            kept = path.with_name(path.name + ".old")
            path.replace(kept)
            yield f"{kept}: the file that was there"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        path.chmod(0o644)
    except PermissionError as err:
        msg = f"{path}: only root may write it; use sudo"
        raise NotAllowed(msg) from err
    except OSError as err:
        msg = f"{path}: cannot be written: {err.strerror or err}"
        raise RadardError(msg) from err
    yield f"{path}: written"


def _shipped(name: str) -> str:
    return (resources.files("radard.units") / name).read_text(encoding="utf-8")


def _unit_word(word: str) -> str:
    """Return a word as it must stand in ExecStart=."""
    if not word.isprintable():
        msg = f"{word!r}: cannot stand in a unit file"
        raise UsageError(msg)
    word = word.replace("%", "%%").replace("$", "$$")
    if re.search(r"[\s\"'\\;]", word):
        return '"' + word.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return word


def _parser() -> Parser:
    about = "Print or install what the system needs; see a mount's coverage."
    parser = new_parser("radard setup", about, _EXAMPLES)
    whats = parser.add_subparsers(dest="what", required=True, metavar="udev|systemd|coverage")
    udev = _sub(whats, "udev", "names it /dev/x2radar, keeps ModemManager off")
    udev.add_argument("--usb", metavar="VVVV:PPPP", help="an adapter's USB id (x2radar ports)")
    udev.add_argument("--serial", metavar="TEXT", help="and its serial number")
    systemd = _sub(whats, "systemd", "starts radard with the machine, watches over it")
    systemd.add_argument("--port", default="/dev/x2radar", help="as for radard (/dev/x2radar)")
    systemd.add_argument("--exec", type=Path, metavar="FILE", help="the radard to start (this)")
    for sub in (udev, systemd):
        sub.add_argument("--install", action="store_true", help="write it, as root")
        sub.add_argument("--root", type=Path, default="/", metavar="DIR", help="instead of /")
    coverage = _sub(whats, "coverage", "signal over noise of a body, by height and range")
    add = coverage.add_argument
    add("--height", type=float, default=1.5, metavar="M", help="of the radar over the floor (1.5)")
    add("--tilt", type=float, default=0.0, metavar="DEG", help="down from level (0)")
    add("--width", type=float, default=65.0, metavar="DEG", help="beam, full at half power (65)")
    add("--limit", type=float, default=10.0, metavar="DB", help="least that is seen (10)")
    add("--rcs", type=float, default=0.01, metavar="M2", help="cross section (0.01: a shank)")
    return parser


def _sub(subs: "argparse._SubParsersAction[Parser]", name: str, text: str) -> Parser:
    return subs.add_parser(
        name,
        help=text,
        description=f"It {text}." if name != "coverage" else f"Show the {text}.",
        epilog=f"example:\n  radard setup {name}\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
