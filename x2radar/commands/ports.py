"""`x2radar ports`: the serial ports of this machine, and whether a module answers."""

import argparse
import json
from dataclasses import asdict

from x2radar.commands import Commands, add_command
from x2radar.device.discovery import list_ports, port_state


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "ports",
        "list serial ports and what is known of them",
        "example:\n  x2radar ports --probe\n",
    )
    parser.add_argument("--probe", action="store_true", help="ping every port, one after another")
    parser.add_argument("--json", action="store_true", help="one JSON object a port")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    rows = list_ports()
    if not rows and not args.json:
        print("no serial ports")
    for row in rows:
        is_module, state = port_state(row.path) if args.probe else (None, None)
        if args.json:
            print(json.dumps({**asdict(row), "is_module": is_module, "state": state}))
            continue
        known = f"{row.known} ({row.known_from})" if row.known else ""
        maker = f"{row.manufacturer} {row.product}".strip()
        parts = (row.path, state, row.usb_id, maker, row.serial_number, known, row.by_id)
        print("  ".join(part for part in parts if part))
    return 0
