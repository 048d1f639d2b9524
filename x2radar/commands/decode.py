"""`x2radar decode`: a byte trace or wire capture as one JSON object a packet."""

import argparse
import json
from pathlib import Path

from x2radar.commands import Commands, add_command
from x2radar.errors import RecordingError
from x2radar.recording.capture import MAGIC, Capture
from x2radar.recording.trace import describe, describe_capture, read_trace


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands,
        "decode",
        "print a byte trace as one JSON object a packet",
        "example:\n  x2radar decode trace.txt\n",
    )
    parser.add_argument("file", type=Path, help="hex text, raw bytes or a wire capture")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    try:
        with args.file.open("rb") as file:
            data = file.read(len(MAGIC))
            if data != MAGIC:
                data += file.read()
    except OSError as err:
        msg = f"{args.file}: cannot be read: {err.strerror}"
        raise RecordingError(msg) from err
    is_capture = data == MAGIC
    items = describe_capture(Capture(args.file)) if is_capture else describe(read_trace(data))
    for item in items:
        print(json.dumps(item))
    return 0
