"""`x2radar convert`: a recording of any known format into another."""

import argparse
import math
import sys
from pathlib import Path

from x2radar.commands import Commands, add_command
from x2radar.errors import SettingsError
from x2radar.recording.about import Overrides
from x2radar.recording.registry import FORMATS, READABLE, WRITABLE

_AXIS = (
    ("frame_rate_hz", "--frame-rate", "HZ", "frames per second"),
    ("bin_length_m", "--bin-length", "M", "range of one bin, in metres"),
    ("range_offset_m", "--range-offset", "M", "range of bin 0, in metres"),
    ("carrier_hz", "--carrier", "HZ", "centre frequency"),
    ("bandwidth_hz", "--bandwidth", "HZ", "bandwidth at -10 dB"),
    ("sample_rate_hz", "--sample-rate", "HZ", "rate of the RF sampler"),
)


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "convert",
        "write a recording in another format",
        "examples:\n"
        "  x2radar convert dog.h5 dog.npz\n"
        "  x2radar convert walk.npz walk.h5 --frame-rate 200 --bin-length 0.0514\n",
    )
    parser.add_argument("source", type=Path, metavar="IN", help="file or folder to read")
    parser.add_argument("out", type=Path, metavar="OUT", help="file or folder to make")
    parser.add_argument("--from", dest="source_kind", choices=READABLE, help="format of IN")
    parser.add_argument("--to", dest="out_kind", choices=WRITABLE, help="format of OUT")
    for name, option, metavar, text in _AXIS:
        parser.add_argument(option, dest=name, type=float, metavar=metavar, help=text)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    # Late: the readers behind it are slow to import.
    from x2radar.recording.convert import convert  # noqa: PLC0415

    values = {name: getattr(args, name) for name, _, _, _ in _AXIS}
    for name, option, _, _ in _AXIS:
        value, is_signed = values[name], name == "range_offset_m"
        if value is not None and not (math.isfinite(value) and (value > 0 or is_signed)):
            msg = f"{option} {value:g}: must be {'a number' if is_signed else 'above 0'}"
            raise SettingsError(msg)
    done = convert(
        args.source,
        args.out,
        source_kind=args.source_kind,
        out_kind=args.out_kind,
        overrides=Overrides(**values),
    )
    for note in done.notes:
        print(f"x2radar: {note}", file=sys.stderr)
    about = f"{done.n_frames} frames, {done.duration_s:.1f} s, {FORMATS[done.kind].title}"
    print(f"{args.out}: {about}", file=sys.stderr)
    return 0
