"""The command `x2radar`: simulate, record, decode, scenes."""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from x2radar.command import new_parser, run_command
from x2radar.errors import RecordingError, SettingsError
from x2radar.ports import make_radar, parse_port
from x2radar.sim.host import serve
from x2radar.sim.module import SimulatedModule
from x2radar.sim.scene import builtin_scenes, load_scene
from x2radar.trace import describe, read_trace
from x2radar.transport import PtyTransport

_EXAMPLES = """\
examples:
  x2radar scenes                              what can be simulated
  x2radar simulate --scene human --pty        a module to open like a real one
  x2radar record --port sim:dog --duration 10 dog.h5
  x2radar decode trace.txt                    a byte trace as JSON Lines
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run `x2radar`; return its exit code."""
    return run_command("x2radar", _body, argv)


def _body(argv: Sequence[str]) -> int:
    parser = new_parser("x2radar", "Tool for XeThru X2 radar modules.", _EXAMPLES)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    add = commands.add_parser

    sub = add("scenes", help="list the built-in scenes")
    sub.set_defaults(run=_scenes)

    sub = add("simulate", help="serve a simulated module on a pseudo-terminal")
    sub.add_argument("--scene", default="demo", help="built-in scene or YAML file (demo)")
    sub.add_argument("--seed", type=int, default=0, help="same seed, same frames (0)")
    sub.add_argument("--pty", action="store_true", required=True, help="print a device path")
    sub.add_argument("--speed", default="realtime", help="realtime, max or a factor")
    sub.set_defaults(run=_simulate)

    sub = add("record", help="record frames into an HDF5 file")
    sub.add_argument("file", type=Path, help="file to make")
    sub.add_argument("--port", required=True, help="device, URL or sim:SCENE")
    sub.add_argument("--duration", type=float, metavar="S", help="stop after S seconds")
    sub.add_argument("--speed", default="realtime", help="sim: realtime, max or a factor")
    sub.set_defaults(run=_record)

    sub = add("decode", help="print a byte trace as one JSON object a packet")
    sub.add_argument("file", type=Path, help="hex text or raw bytes")
    sub.set_defaults(run=_decode)

    args = parser.parse_args(argv)
    code: int = args.run(args)
    return code


def _scenes(_args: argparse.Namespace) -> int:
    for scene in builtin_scenes():
        print(f"{scene.name:<10} {scene.description}")
    return 0


def _speed(text: str) -> float | None:
    if text in {"realtime", "max"}:
        return 1.0 if text == "realtime" else None
    try:
        factor = float(text)
    except ValueError:
        factor = math.nan
    if not 0 < factor < 1e6:
        msg = f"--speed '{text}': use realtime, max or a factor above 0"
        raise SettingsError(msg)
    return factor


def _simulate(args: argparse.Namespace) -> int:
    if args.seed < 0:
        msg = f"--seed {args.seed}: must be a whole number from 0 up"
        raise SettingsError(msg)
    module = SimulatedModule(load_scene(args.scene), args.seed)
    speed = _speed(args.speed)
    pty = PtyTransport()
    print(pty.path, flush=True)
    try:
        serve(module, pty, speed=speed)
    finally:
        pty.close()
    return 0


def _record(args: argparse.Namespace) -> int:
    # Late, because h5py takes a while and the other subcommands do without it.
    from x2radar.recording import RecordingWriter  # noqa: PLC0415

    if args.duration is not None and not 0 < args.duration < 1e9:
        msg = f"--duration {args.duration:g}: must be above 0, in seconds"
        raise SettingsError(msg)
    if args.file.exists():
        msg = f"{args.file}: exists already; recordings are never overwritten"
        raise RecordingError(msg)
    n = 0
    with make_radar(parse_port(args.port), speed=_speed(args.speed)) as radar:
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


def _decode(args: argparse.Namespace) -> int:
    try:
        data = args.file.read_bytes()
    except OSError as err:
        msg = f"{args.file}: cannot be read: {err.strerror}"
        raise RecordingError(msg) from err
    for item in describe(read_trace(data)):
        print(json.dumps(item))
    return 0


if __name__ == "__main__":
    sys.exit(main())
