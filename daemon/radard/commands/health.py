"""`radard health`: is the daemon that runs on this machine well? Exit code 0 or 1."""

import json
from collections.abc import Sequence
from pathlib import Path

from radard.config import load_config
from radard.directories import status_dirs
from radard.status_file import read_status, status_path
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
    add("--sensor", metavar="NAME", help="which one (the configuration's sensor.name)")
    add("--config", type=Path, metavar="FILE", help="configuration file")
    add("--json", action="store_true", help="all that the status file says")
    args = parser.parse_args(argv)
    config = load_config(args.config)
    name = args.sensor or config.sensor.name
    paths = [status_path(folder, name) for folder in status_dirs(config)]
    report = read_status(next(filter(_is_there, paths), paths[-1]))
    if args.json:
        print(json.dumps({"healthy": report.is_healthy, "line": report.line, **report.content}))
    else:
        print(report.line)
    return 0 if report.is_healthy else 1


def _is_there(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:
        # A folder that others may not look into.
        return False
