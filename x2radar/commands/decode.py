"""`x2radar decode`: a byte trace as one JSON object a packet."""

import argparse
import json
from pathlib import Path

from x2radar.commands import Commands
from x2radar.errors import RecordingError
from x2radar.trace import describe, read_trace


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser("decode", help="print a byte trace as one JSON object a packet")
    parser.add_argument("file", type=Path, help="hex text or raw bytes")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    try:
        data = args.file.read_bytes()
    except OSError as err:
        msg = f"{args.file}: cannot be read: {err.strerror}"
        raise RecordingError(msg) from err
    for item in describe(read_trace(data)):
        print(json.dumps(item))
    return 0
