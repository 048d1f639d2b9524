"""`x2radar record`: frames of a module into an HDF5 recording."""

import argparse
import math
import sys
from contextlib import ExitStack
from dataclasses import asdict
from itertools import chain
from pathlib import Path

from x2radar.commands import Commands, add_command, check_duration
from x2radar.errors import SettingsError, X2RadarError
from x2radar.ports import PORT_FORMS, parse_port, parse_speed
from x2radar.radars import make_radar

_MB = 1e6


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands,
        "record",
        "record frames into an HDF5 file",
        "examples:\n"
        "  x2radar record --port /dev/ttyACM0 --rotate-time 3600 night.h5\n"
        "  x2radar record --port 'sim:dog?seed=4' --duration 10 --speed max dog.h5\n",
    )
    add = parser.add_argument
    add("file", type=Path, help="file to make; in parts FILE_000.h5, FILE_001.h5 ...")
    add("--port", required=True, help=PORT_FORMS)
    add("--duration", type=float, metavar="S", help="stop after S seconds")
    add("--rotate-size", type=float, metavar="MB", help="begin a new part before MB are full")
    add("--rotate-time", type=float, metavar="S", help="begin a new part every S seconds")
    add("--free-floor", type=float, metavar="MB", default=200.0, help="space to leave (200)")
    add("--capture-wire", type=Path, metavar="FILE", help="keep the raw bytes as well")
    add("--fsync", action="store_true", help="survive a power failure: sync every second")
    add("--speed", default="realtime", help="sim: realtime, max or a factor")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    # Late, because h5py takes a while and the other subcommands do without it.
    from x2radar.recording.capture import CaptureWriter, capturing  # noqa: PLC0415
    from x2radar.recording.parts import RotatingWriter, check_free_name  # noqa: PLC0415
    from x2radar.recording.recorder import RecordingProgress, record, stop_flag  # noqa: PLC0415
    from x2radar.recording.stamps import utc_text  # noqa: PLC0415

    _check(args)
    check_free_name(args.file, rotating=bool(args.rotate_size or args.rotate_time))
    radar = make_radar(parse_port(args.port), speed=parse_speed(args.speed))
    paths = (args.file, args.capture_wire) if args.capture_wire else (args.file,)
    _check_space(args, paths)
    radar.identify()
    settings = asdict(radar.settings)
    with ExitStack() as open_now:
        if args.capture_wire:
            about = {"started_utc": utc_text(), "port": radar.name, "settings": settings}
            wire = CaptureWriter(args.capture_wire, about)
            open_now.callback(wire.close)
            radar.wrap_transport(lambda connect: capturing(connect, wire))
        open_now.enter_context(radar)
        frames = radar.frames()
        first = next(frames)
        assert radar.stream is not None  # noqa: S101 - known with the first frame
        rate_hz = radar.stream.frame_rate_hz
        stop = open_now.enter_context(stop_flag())
        writer = open_now.enter_context(
            RotatingWriter(
                args.file,
                radar.stream,
                started_utc=utc_text(),
                device={"name": radar.name},
                settings=settings,
                rotate_bytes=args.rotate_size and args.rotate_size * _MB,
                rotate_s=args.rotate_time,
                fsync=args.fsync,
            )
        )
        tally = record(
            chain([first], frames),
            writer,
            stop=stop,
            most_frames=math.inf
            if args.duration is None
            else max(1, round(args.duration * rate_hz)),
            check_every=max(1, round(rate_hz)),
            floor_bytes=args.free_floor * _MB,
            paths=paths,
            progress=RecordingProgress(args.file.name, sys.stderr),
        )
    parts = f", {len(writer.paths)} parts" if writer.is_rotating else ""
    lost = f", {tally.n_lost} lost" if tally.n_lost else ""
    line = f"{args.file}: {tally.n_frames} frames, {tally.n_frames / rate_hz:.1f} s{lost}{parts}"
    if tally.is_full:
        msg = f"{line}; stopped, less than {args.free_floor:g} MB are free (--free-floor)"
        raise X2RadarError(msg)
    print(line, file=sys.stderr)
    return 0


def _check(args: argparse.Namespace) -> None:
    check_duration(args.duration)
    for option, value, unit in (
        ("--rotate-size", args.rotate_size, "MB"),
        ("--rotate-time", args.rotate_time, "seconds"),
    ):
        if value is not None and not 0 < value < 1e9:
            msg = f"{option} {value:g}: must be above 0, in {unit}"
            raise SettingsError(msg)
    if not 0 <= args.free_floor < 1e9:
        msg = f"--free-floor {args.free_floor:g}: must be 0 or more, in MB"
        raise SettingsError(msg)


def _check_space(args: argparse.Namespace, paths: tuple[Path, ...]) -> None:
    from x2radar.recording.recorder import free_bytes  # noqa: PLC0415 - with the other late ones

    free = free_bytes(*paths)
    if free < args.free_floor * _MB:
        msg = (
            f"{args.file}: {free / _MB:.0f} MB are free there, less than the "
            f"{args.free_floor:g} MB to leave (--free-floor)"
        )
        raise X2RadarError(msg)
