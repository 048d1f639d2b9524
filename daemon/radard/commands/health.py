"""`radard health`: is the daemon that runs on this machine well? Exit code 0 or 1."""

import json
from collections.abc import Sequence
from pathlib import Path

from radard.config.config import Config, load_config
from radard.config.directories import status_dirs
from radard.health.status_file import StatusReport, read_status, status_path
from x2radar.command import new_parser

_EXAMPLES = """\
examples:
  radard health                    exit code 0: decisions are made from fresh frames
  radard health --sensor hall --json
"""


def run(argv: Sequence[str]) -> int:
    """Run the subcommand."""
    parser = new_parser("radard health", "Ask after the daemon that runs here.", _EXAMPLES)
    add = parser.add_argument
    add("--sensor", metavar="NAME", help="only this one (all that are configured)")
    add("--config", type=Path, metavar="FILE", help="configuration file")
    add("--json", action="store_true", help="all that the status file says")
    args = parser.parse_args(argv)
    config = load_config(args.config)
    names = [args.sensor] if args.sensor else [each.sensor.name for each in config.each()]
    reports = {name: _report(name, config) for name in names}
    for name, report in reports.items():
        if args.json:
            about = {"healthy": report.is_healthy, "line": report.line, **report.content}
            print(json.dumps({"sensor": name, **about} if len(reports) > 1 else about))
        else:
            print(f"{name}: {report.line}" if len(reports) > 1 else report.line)
    # As /healthz says it: degraded, with one of several away, is not down.
    return 0 if any(report.is_healthy for report in reports.values()) else 1


def _report(name: str, config: Config) -> StatusReport:
    paths = [status_path(folder, name) for folder in status_dirs(config)]
    return read_status(next(filter(_is_there, paths), paths[-1]))


def _is_there(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        # A folder that others may not look into.
        return False
