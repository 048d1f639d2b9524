"""`x2radar selftest`: a report on a module, and a short recording to send in."""

import argparse
import json
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from x2radar.commands import Commands, add_command, check_duration
from x2radar.device.device import X2Radar
from x2radar.errors import RecordingError
from x2radar.ports import PORT_FORMS, parse_port
from x2radar.radars import make_radar


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands,
        "selftest",
        "test a module and make a report to send in",
        "example:\n  x2radar selftest --port /dev/ttyACM0 --out mine.h5 > report.txt\n",
    )
    parser.add_argument("--port", required=True, help=PORT_FORMS)
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="seconds (10)")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="recording to make (x2radar-selftest-TIME.h5, in this folder)",
    )
    parser.add_argument("--json", action="store_true", help="the report as one JSON object")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    # Late, as are the recordings below: both load much that other subcommands do without.
    from x2radar.selftest import selftest, software  # noqa: PLC0415

    check_duration(args.duration)
    now = datetime.now(UTC)
    out = args.out or Path(f"x2radar-selftest-{now:%Y%m%dT%H%M%SZ}.h5")
    if out.exists():
        msg = f"{out}: exists already; recordings are never overwritten"
        raise RecordingError(msg)
    radar = make_radar(parse_port(args.port))
    found = selftest(radar, args.duration)
    report = {
        "software": software(),
        "port": args.port,
        "started_utc": now.isoformat(timespec="seconds").replace("+00:00", "Z"),
        "ping": found.ping or None,
        "info": found.info,
        "settings": asdict(radar.settings),
        "figures": found.figures,
        "verdicts": [verdict._asdict() for verdict in found.verdicts],
        "recording": str(out) if found.frames else None,
    }
    if found.frames:
        _record(out, radar, found.frames, report)
    print(json.dumps(report) if args.json else "\n".join(_lines(report)), flush=True)
    if found.error is not None and not found.frames:
        raise found.error
    return 0


def _record(out: Path, radar: X2Radar, frames: list[Any], report: dict[str, Any]) -> None:
    from x2radar.recording.hdf5_writer import RecordingWriter  # noqa: PLC0415

    assert radar.stream is not None  # noqa: S101 - known with the first frame
    about = {"name": radar.name, **report["info"], "selftest": report}
    with RecordingWriter(
        out,
        radar.stream,
        started_utc=report["started_utc"],
        device=about,
        settings=report["settings"],
    ) as writer:
        for frame in frames:
            writer.write(frame)


def _lines(report: dict[str, Any]) -> list[str]:
    lines = [f"self-test of {report['port']}, {report['started_utc']}"]
    for title in ("software", "info", "settings", "figures"):
        lines += [f"{title}:"] if report[title] else []
        lines += [f"  {name:<24} {_short(value)}" for name, value in report[title].items()]
    lines.append("verdicts:")
    lines += [f"  {v['level'].upper():<4} {v['about']:<10} {v['why']}" for v in report["verdicts"]]
    if report["recording"]:
        lines.append(f"the recording to send in: {report['recording']}")
    return lines


def _short(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
