"""`x2radar record`: frames of a module into an HDF5 recording."""

import argparse
import math
import sys
from datetime import UTC, datetime
from pathlib import Path

from x2radar.commands import Commands, check_duration, parse_speed
from x2radar.errors import RecordingError
from x2radar.ports import make_radar, parse_port


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser("record", help="record frames into an HDF5 file")
    parser.add_argument("file", type=Path, help="file to make")
    parser.add_argument("--port", required=True, help="device, URL or sim:SCENE")
    parser.add_argument("--duration", type=float, metavar="S", help="stop after S seconds")
    parser.add_argument("--speed", default="realtime", help="sim: realtime, max or a factor")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    # Late, because h5py takes a while and the other subcommands do without it.
    from x2radar.recording import RecordingWriter  # noqa: PLC0415

    check_duration(args.duration)
    if args.file.exists():
        msg = f"{args.file}: exists already; recordings are never overwritten"
        raise RecordingError(msg)
    n = 0
    with make_radar(parse_port(args.port), speed=parse_speed(args.speed)) as radar:
        frames = radar.frames()
        first = next(frames)
        assert radar.stream is not None  # noqa: S101 - known with the first frame
        rate_hz = radar.stream.frame_rate_hz
        most = math.inf if args.duration is None else max(1, round(args.duration * rate_hz))
        started = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        with RecordingWriter(
            args.file, radar.stream, started_utc=started, device={"name": radar.name}, settings={}
        ) as writer:
            try:
                writer.write(first)
                n = 1
                for frame in frames:
                    if frame.index >= most:
                        break
                    writer.write(frame)
                    n += 1
            except KeyboardInterrupt:
                pass
    print(f"{args.file}: {n} frames, {n / rate_hz:.1f} s", file=sys.stderr)
    return 0
