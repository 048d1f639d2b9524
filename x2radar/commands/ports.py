"""`x2radar ports`: the serial ports of this machine, and whether a module answers."""

import argparse
import json
from dataclasses import asdict

from x2radar.commands import Commands
from x2radar.discovery import answers, list_ports
from x2radar.errors import PortError


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "ports",
        help="list serial ports and what is known of them",
        epilog="example:\n  x2radar ports --probe\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--probe", action="store_true", help="ping every port")
    parser.add_argument("--json", action="store_true", help="one JSON object a port")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    rows = list_ports()
    if not rows and not args.json:
        print("no serial ports")
    for row in rows:
        state = _probe(row.path) if args.probe else ""
        if args.json:
            print(json.dumps({**asdict(row), "answer": state or None}))
            continue
        parts = (row.path, row.usb_id or "-", row.product or "-", row.known, state, row.by_id)
        print("  ".join(part for part in parts if part))
    return 0


def _probe(path: str) -> str:
    try:
        return "a module answers" if answers(path) else "no answer"
    except PortError as err:
        return str(err)
