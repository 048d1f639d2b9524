"""`x2radar selftest`: a report on a module, and a short recording to send in."""

import argparse
import json
from datetime import UTC, datetime
from pathlib import Path

from x2radar.command import installed_version
from x2radar.commands import Commands, check_duration
from x2radar.errors import RecordingError
from x2radar.ports import make_radar, parse_port
from x2radar.selftest import Report, ask_info, collect, judge


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = commands.add_parser(
        "selftest",
        help="test a module and make a report to send in",
        epilog="example:\n  x2radar selftest --port /dev/ttyACM0 --out mine.h5 > report.txt\n",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--port", required=True, help="device, URL or sim:SCENE")
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="seconds (10)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="keep the frames, to send in")
    parser.add_argument("--json", action="store_true", help="the report as one JSON object")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    # Late, because h5py takes a while.
    from x2radar.recording import RecordingWriter  # noqa: PLC0415

    check_duration(args.duration)
    if args.out is not None and args.out.exists():
        msg = f"{args.out}: exists already; recordings are never overwritten"
        raise RecordingError(msg)
    with make_radar(parse_port(args.port)) as radar:
        info = ask_info(radar)
        frames = collect(radar, args.duration)
        report = judge(radar, frames)
        report.info = info
        if args.out is not None and radar.stream is not None:
            now = datetime.now(UTC).isoformat(timespec="seconds")
            with RecordingWriter(
                args.out,
                radar.stream,
                started_utc=now,
                device={"name": radar.name, **info},
                settings={},
            ) as writer:
                for frame in frames:
                    writer.write(frame)
    _print(args, report)
    return 0


def _print(args: argparse.Namespace, report: Report) -> None:
    if args.json:
        print(
            json.dumps(
                {
                    "version": installed_version(),
                    "port": args.port,
                    "info": report.info,
                    "figures": report.figures,
                    "verdicts": report.verdicts,
                    "recording": str(args.out) if args.out else None,
                }
            )
        )
        return
    print(f"x2radar {installed_version()} on {args.port}")
    for name, text in report.info.items():
        print(f"  {name:<24} {text}")
    for name, value in report.figures.items():
        print(f"  {name:<24} {value:g}")
    for verdict, why in report.verdicts:
        print(f"  {verdict.upper():<5} {why}")
    if args.out:
        print(f"the frames are in {args.out}")
