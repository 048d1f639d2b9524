"""`radard health` and `status`: how is the daemon that runs on this machine? Exit code 0 or 1."""

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

from radard.config.config import load_config
from radard.config.directories import status_dirs
from radard.config.options import add_options
from radard.health.status_file import read_status, status_path
from x2radar.command import Parser, new_parser

_ABOUT = {
    "health": (
        "Ask after the daemon that runs here.",
        "exit code 0: decisions are made from fresh frames",
    ),
    "status": (
        "Tell what the daemon that runs here is doing.",
        "online, armed, nobody there, a decision 0.4 s ago",
    ),
}
_EXAMPLES = """\
examples:
  radard {0}                    {1}
  radard {0} --sensor hall --json
"""


def told(line: str, panel: Mapping[str, Any]) -> str:
    """Return a line for people of a state and of what a panel says (`SensorState.as_record`)."""
    how = "armed at home" if panel.get("mode") == "home" else "armed"
    parts = [line, how if panel["armed"] else "disarmed"]
    delays = {"exit": ["exit delay"], "entry": ["entry delay"], "alarm": ["ALARM"]}
    parts += delays.get(str(panel.get("panel")), [])
    gate = panel.get("gate")
    seen = "nobody moves" if gate == "closed" else panel.get("label") or "something moves"
    parts += [str(seen)] if gate else []
    if drift := panel.get("clock_drift"):
        ppm, about_ppm = 1e6 * drift["ratio"], 1e6 * drift["uncertainty"]
        parts.append(f"module's clock {ppm:+.0f} ppm (within {about_ppm:.0f})")
    if "decision_age_s" in panel:
        parts.append(f"decided {float(panel['decision_age_s']):.1f} s ago")
    return ", ".join([*parts, *(m for m in ("simulated", "replayed") if panel.get(m))])


def make_parser(name: str) -> Parser:
    text, example = _ABOUT[name]
    parser = new_parser(f"radard {name}", text, _EXAMPLES.format(name, example))
    add_options(parser, "--sensor", "--config")
    parser.add_argument("--json", action="store_true", help="all that the status file says")
    return parser


def run(argv: Sequence[str], name: str) -> int:
    """Run the subcommand of a name; `status` tells more of what is well."""
    args = make_parser(name).parse_args(argv)
    config = load_config(args.config)
    names = [args.sensor] if args.sensor else [each.sensor.name for each in config.each()]
    reports = {}
    for sensor in names:
        paths = [status_path(folder, sensor) for folder in status_dirs(config)]
        # Not Path.is_file, which raises where others may not look into the folder.
        reports[sensor] = read_status(next(filter(os.path.isfile, paths), paths[-1]))
    for sensor, report in reports.items():
        if args.json:
            about = {"healthy": report.is_healthy, "line": report.line, **report.content}
            print(json.dumps({"sensor": sensor, **about} if len(reports) > 1 else about))
        else:
            is_told = name == "status" and report.is_healthy and "armed" in report.content
            line = told(report.line, report.content) if is_told else report.line
            print(f"{sensor}: {line}" if len(reports) > 1 else line)
    # As /healthz says it: degraded, with one of several away, is not down.
    return 0 if any(report.is_healthy for report in reports.values()) else 1
