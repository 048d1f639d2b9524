"""`radard status`, `health`, `arm`, `disarm`, `ack`, `test-alarm`: the daemon that runs here."""

import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from radard.config.config import Config, load_config
from radard.config.directories import status_dirs
from radard.config.options import add_options
from radard.config.sections import SensorEntry
from radard.errors import NotAllowed, RadardError, UsageError
from radard.health.heartbeat import read_status, status_path
from radard.run.control import ask, control_path
from x2radar.command import Parser, new_parser
from x2radar.errors import BriefError

_WORDS = {
    "health": "Ask after the daemon that runs here.",
    "status": "Tell what the daemon that runs here is doing.",
    "arm": "Arm the daemon that runs here.",
    "disarm": "Disarm the daemon that runs here; an alarm ends.",
    "ack": "Acknowledge an alarm of the daemon that runs here; it ends, the sensor stays armed.",
    "test-alarm": "Send a marked event through every output; say what each made of it.",
}
_ASKS = {
    "health": "exit code 0: decisions are made from fresh frames",
    "status": "online, armed, nobody there, a decision 0.4 s ago",
}
_ASK_EXAMPLES = """\
examples:
  radard {0}                    {1}
  radard {0} --sensor hall --json
"""
_EXAMPLES = """\
examples:
  radard {0}
  radard {0} --sensor hall

The daemon's own user and root may do that: sudo -u radard radard {0}
"""
_SAYS = {"look": {"status", "panel", "records", "outputs", "picture"}, "test-alarm": {"outputs"}}
_TOLD = {"armed", "mode", "panel", "delay_left_s", "ended"}  # what all other answers have


class NoDaemon(RadardError):
    """No running daemon answers on the control socket."""


def make_parser(name: str) -> Parser:
    examples = _ASK_EXAMPLES if name in _ASKS else _EXAMPLES
    examples = examples.format(name, _ASKS.get(name))
    parser = new_parser(f"radard {name}", _WORDS[name], examples)
    if name in _ASKS:
        parser.add_argument("--json", action="store_true", help="all that the status file says")
    if name == "arm":
        text = "leave out zones.away: people are at home"
        parser.add_argument("--home", action="store_true", help=text)
    add_options(parser, "--sensor", "--config")
    return parser


def run(argv: Sequence[str], name: str) -> int:
    """Run the subcommand of a name; 1 when nobody is well, or a test alarm failed somewhere."""
    args = make_parser(name).parse_args(argv)
    config = config_to_ask(args.config)
    if name in _ASKS:
        return _report(config, args.sensor, as_json=args.json, is_status=name == "status")
    command = "arm-home" if name == "arm" and args.home else name
    is_well, faults = True, []
    for sensor in sensors_asked(config, args.sensor):
        head = f"{sensor}: " if len(config.each()) > 1 else ""
        try:
            answer = asked(config, sensor, command)
        except NoDaemon as err:
            # The others are asked all the same.
            faults.append(f"{head}{err}")
            continue
        print(*(f"{head}{line}" for line in _lines(name, answer)), sep="\n")
        answers = [each["answer"] for each in answer.get("outputs", ())]
        is_well = is_well and {*answers} <= {"taken", "not wanted there"}
    if faults:
        raise NoDaemon("; ".join(faults))
    return 0 if is_well else 1


def config_to_ask(file: Path | None) -> Config:
    """Return the configuration; where it is none by now, one of the sensors that report here."""
    try:
        return load_config(file)
    except BriefError as err:
        config, tail = Config(), ".status.json"
        # The daemon goes on with what it has read; a file that is edited keeps nobody from it.
        found = (path for folder in status_dirs(config) for path in folder.glob(f"*{tail}"))
        names = sorted({path.name.removesuffix(tail) for path in found})
        if not names:
            raise
        sys.stderr.write(f"radard: {err}; asked is who runs here: {', '.join(names)}\n")
        sensors = {name: SensorEntry(port="auto") for name in names}
        return config.model_copy(update={"sensors": sensors})


def sensors_asked(config: Config, sensor: str | None) -> list[str]:
    """Return the sensors that a command is for; raises UsageError if there is none of the name."""
    known = [each.sensor.name for each in config.each()]
    if sensor and config.is_one_of_several and sensor not in known:
        raise UsageError(f"no sensor '{sensor}'; known are {', '.join(known)}")
    return [sensor] if sensor else known


def asked(config: Config, sensor: str, command: str) -> Mapping[str, Any]:
    """Give a sensor's daemon a command; return the answer, NoDaemon or NotAllowed without one."""
    paths = [control_path(folder, sensor) for folder in status_dirs(config)]
    fault = f"no radard runs here: no {paths[-1]}"
    for path in paths:
        try:
            answer = ask(path, command)
        except PermissionError as err:
            raise NotAllowed(f"{path} is another user's; try sudo radard {command}") from err
        except FileNotFoundError:
            continue
        except (OSError, ValueError, TypeError) as err:
            # As that of a daemon that was killed; another one may have the next.
            fault = f"{path}: no radard answers ({getattr(err, 'strerror', None) or err})"
            continue
        if answer.get("ok") is False:
            raise NoDaemon(str(answer.get("error", "refused")))
        if not _SAYS.get(command, _TOLD) <= set(answer):
            raise NoDaemon(f"{path}: a radard of another version answers; start that again")
        return answer
    raise NoDaemon(fault)


def _lines(name: str, answer: Mapping[str, Any]) -> list[str]:
    if name == "test-alarm":
        return [f"{each['output']}: {each['answer']}" for each in answer["outputs"]]
    lost = f", until it is started again: {answer['lost']}" if answer.get("lost") else ""
    armed, ended = answer["armed"], answer["ended"]
    if armed is None:
        return [f"{name}: taken, there is no stream yet{lost}"]
    if name == "ack":
        return [f"acknowledged: {ended}{lost}" if ended else "no alarm is on"]
    how = "armed at home" if answer["mode"] == "home" else "armed"
    wait = f" in {answer['delay_left_s']:.0f} s" if answer["panel"] == "exit" else ""
    return [f"{how}{wait}{lost}" if armed else f"disarmed{lost}"]


def _report(config: Config, sensor: str | None, *, as_json: bool, is_status: bool) -> int:
    """Print what status files say, `is_status` more of what is well; return the exit code."""
    reports = {}
    for name in [sensor] if sensor else [each.sensor.name for each in config.each()]:
        paths = [status_path(folder, name) for folder in status_dirs(config)]
        # Not Path.is_file, which raises where others may not look into the folder.
        reports[name] = read_status(next(filter(os.path.isfile, paths), paths[-1]))
    for name, report in reports.items():
        if as_json:
            about = {"healthy": report.is_healthy, "line": report.line, **report.content}
            print(json.dumps({"sensor": name, **about} if len(reports) > 1 else about))
        else:
            is_told = is_status and report.is_healthy and "armed" in report.content
            line = told(report.line, report.content) if is_told else report.line
            print(f"{name}: {line}" if len(reports) > 1 else line)
    # As /healthz says it: degraded, with one of several away, is not down.
    return 0 if any(report.is_healthy for report in reports.values()) else 1


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
