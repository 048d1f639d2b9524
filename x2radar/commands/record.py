"""`x2radar record`: frames of a module into an HDF5 recording, until told, out of time or space.

A signal is taken between two frames, never inside a write, so every end is a clean one.
"""

import argparse
import math
import shutil
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from x2radar import errors
from x2radar.command import StatusLine
from x2radar.commands import Commands, add_command, check_above_zero
from x2radar.device.device import X2Radar
from x2radar.frame import Frame
from x2radar.ports import PORT_FORMS, Port, parse_port, parse_speed
from x2radar.radars import make_radar
from x2radar.recording.blocks import Label
from x2radar.recording.capture import CaptureWriter, CapturingTransport
from x2radar.recording.faults import refuse_taken
from x2radar.recording.registry import check_name
from x2radar.sim.scene.scene import load_scene
from x2radar.sim.scene.stage import Stage
from x2radar.startup import STOP
from x2radar.wall_clock import utc_text

if TYPE_CHECKING:
    from x2radar.recording.parts import RotatingWriter

_MB = 1e6


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "record",
        "record frames into an HDF5 file",
        "examples:\n"
        "  x2radar record --port /dev/ttyACM0 --rotate-time 3600 night.h5\n"
        "  x2radar record --port /dev/ttyACM0 --duration 60 --label pet cat.h5\n"
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
    add("--label", metavar="NAME", help="who is there: human, pet ...; sim: says so itself")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    # Late, because h5py takes a while and the other subcommands do without it.
    from x2radar.recording.parts import RotatingWriter, existing_parts  # noqa: PLC0415

    _check(args)
    parts = existing_parts(args.file) if args.rotate_size or args.rotate_time else []
    for taken in (args.file, *parts):
        refuse_taken(taken)
    port = parse_port(args.port)
    radar = make_radar(port, speed=parse_speed(args.speed))
    paths = (args.file, args.capture_wire) if args.capture_wire else (args.file,)
    if (free := free_bytes(*paths)) < args.free_floor * _MB:
        raise errors.X2RadarError(
            f"{args.file}: {free / _MB:.0f} MB are free there, less than the "
            f"{args.free_floor:g} MB to leave (--free-floor)"
        )
    radar.identify()
    settings = asdict(radar.settings)
    with ExitStack() as open_now:
        if args.capture_wire:
            about = {"started_utc": utc_text(), "port": radar.name, "settings": settings}
            wire = CaptureWriter(args.capture_wire, about)
            open_now.callback(wire.close)
            radar.wrap_transport(lambda inner: CapturingTransport(inner, wire))
        open_now.enter_context(radar)
        frames = radar.frames()
        first = next(frames)
        assert radar.stream is not None  # noqa: S101 - known with the first frame
        rate_hz = radar.stream.frame_rate_hz
        stops = open_now.enter_context(stop_signals())
        writer = RotatingWriter(
            args.file,
            radar.stream,
            started_utc=utc_text(),
            device={"name": radar.name},
            settings=settings,
            rotate_bytes=args.rotate_size and args.rotate_size * _MB,
            rotate_s=args.rotate_time,
            fsync=args.fsync,
        )
        with writer:
            tally = record(
                chain([first], frames),
                writer,
                stops=stops,
                max_frames=max(1, round(args.duration * rate_hz)) if args.duration else math.inf,
                check_every=max(1, round(rate_hz)),
                floor_bytes=args.free_floor * _MB,
                paths=paths,
            )
        writer.label(_labels(args.label, port, radar, first.counter))
    n_parts = f", {len(writer.paths)} parts" if writer.is_rotating else ""
    lost = f", {tally.n_lost} lost" if tally.n_lost else ""
    line = f"{args.file}: {tally.n_frames} frames, {tally.n_frames / rate_hz:.1f} s{lost}{n_parts}"
    if tally.is_full:
        msg = f"{line}; stopped, less than {args.free_floor:g} MB are free (--free-floor)"
        raise errors.X2RadarError(msg)
    print(line, file=sys.stderr)
    return 0


def _check(args: argparse.Namespace) -> None:
    check_name(args.file, "hdf5")
    if args.capture_wire is not None:
        check_name(args.capture_wire, "capture")
    check_above_zero("--duration", args.duration, "seconds")
    check_above_zero("--rotate-size", args.rotate_size, "MB")
    check_above_zero("--rotate-time", args.rotate_time, "seconds")
    if args.label is not None and not (args.label.strip() and args.label.isprintable()):
        raise errors.SettingsError("--label: must be a word, such as human or pet")
    if not 0 <= args.free_floor < 1e9:
        raise errors.SettingsError(f"--free-floor {args.free_floor:g}: must be 0 or more, in MB")


def _labels(name: str | None, port: Port, radar: X2Radar, counter: int) -> list[Label]:
    """Return who was there, as the user or the scene says; nobody knows after a restart."""
    if name is not None:
        return [(0.0, math.inf, name)]
    if port.kind != "sim" or radar.stats.restarts:
        return []
    rate_hz, n_frames = radar.settings.frame_rate_hz, radar.stats.frames + radar.stats.lost
    seed, before_s = int(port.options.get("seed", "0")), (counter - 1) / rate_hz
    labels = Stage(load_scene(port.target), seed, rate_hz).labels(before_s + n_frames / rate_hz)
    return [(t0_s - before_s, t1_s - before_s, label) for t0_s, t1_s, label in labels]


def free_bytes(*paths: Path) -> float:
    """Return the least free space where `paths` are made, in bytes; inf when unknown."""
    with suppress(OSError):
        return min((shutil.disk_usage(path.parent).free for path in paths), default=math.inf)
    return math.inf


@contextmanager
def stop_signals() -> Iterator[list[int]]:
    """Lend a list that gets the first SIGINT or SIGTERM; the second interrupts."""
    stops: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield stops
        return

    def handle(number: int, _frame: object) -> None:
        if stops:
            raise KeyboardInterrupt
        stops.append(number)

    before = {n: signal.signal(n, handle) for n in STOP}
    try:
        yield stops
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@dataclass(slots=True)
class Tally:
    """Frames that a recording took and lost, and whether the disk was full."""

    n_frames: int = 0
    n_lost: int = 0
    is_full: bool = False


def record(
    frames: Iterator[Frame],
    writer: "RotatingWriter",
    *,
    stops: Sequence[int],
    max_frames: float,
    check_every: int,
    floor_bytes: float = 0.0,
    paths: tuple[Path, ...] = (),
) -> Tally:
    """Write frames until the stream is long enough, a signal has come or the disk is full."""
    tally, line, begun_s = Tally(), StatusLine(sys.stderr), time.monotonic()
    try:
        for frame in frames:
            if frame.index >= max_frames:
                break
            try:
                writer.write(frame)
            except errors.RecordingError as err:
                # No bad input, as reading a recording would be: exit code 1.
                raise errors.X2RadarError(str(err)) from err
            tally.n_frames += 1
            tally.n_lost += frame.lost if tally.n_frames > 1 else 0
            if tally.n_frames % check_every == 0:
                tally.is_full = free_bytes(*paths) < floor_bytes
                rate_hz = tally.n_frames / (time.monotonic() - begun_s)
                line.show(
                    f"{tally.n_frames} frames, {rate_hz:.1f} Hz, {tally.n_lost} lost, "
                    f"{writer.n_bytes / _MB:.1f} MB"
                )
            if stops or tally.is_full:
                break
    except (errors.ReadTimeout, errors.TransportClosed):
        if not stops:
            raise
    finally:
        line.clear()
    return tally
