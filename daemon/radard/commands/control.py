"""`radard arm`, `disarm` and `test-alarm`: commands to the daemon that runs on this machine."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from radard.config.config import load_config
from radard.config.directories import status_dirs
from radard.errors import NotAllowed, RadardError, UsageError
from radard.run.control import ask, control_path
from x2radar.command import Parser, new_parser

_WORDS = {
    "arm": "Arm the daemon that runs here.",
    "disarm": "Disarm the daemon that runs here; an alarm ends.",
    "test-alarm": "Send a marked event through every output; say what each made of it.",
}
_EXAMPLES = """\
examples:
  radard {0}
  radard {0} --sensor hall

The daemon's own user and root may do that: sudo -u radard radard {0}
"""


class NoDaemon(RadardError):
    """No daemon answers."""

    exit_code = 1


def make_parser(name: str) -> Parser:
    """Return the parser of the subcommand of a name."""
    parser = new_parser(f"radard {name}", _WORDS[name], _EXAMPLES.format(name))
    add = parser.add_argument
    if name == "arm":
        add("--home", action="store_true", help="leave out zones.away: people are at home")
    add("--sensor", metavar="NAME", help="only this one (all that are configured)")
    add("--config", type=Path, metavar="FILE", help="configuration file")
    return parser


def run(argv: Sequence[str], name: str) -> int:
    """Run the subcommand of a name; 1 when a test alarm failed somewhere."""
    args = make_parser(name).parse_args(argv)
    command = "arm-home" if name == "arm" and args.home else name
    config = load_config(args.config)
    known = [each.sensor.name for each in config.each()]
    if args.sensor and config.is_one_of_several and args.sensor not in known:
        msg = f"no sensor '{args.sensor}'; known are {', '.join(known)}"
        raise UsageError(msg)
    is_well = True
    for sensor in [args.sensor] if args.sensor else known:
        answer = _asked([control_path(folder, sensor) for folder in status_dirs(config)], command)
        head = f"{sensor}: " if len(known) > 1 else ""
        if name == "test-alarm":
            for each in answer["outputs"]:
                print(f"{head}{each['output']}: {each['answer']}")
                is_well = is_well and not each["answer"].startswith("failed")
        elif answer["armed"] is None:
            print(f"{head}{name}: holds once there is a stream")
        else:
            print(f"{head}{_panel_line(answer)}")
    return 0 if is_well else 1


def _asked(paths: Sequence[Path], command: str) -> Mapping[str, Any]:
    answer: Mapping[str, Any] | None = None
    for path in paths:
        try:
            answer = ask(path, command)
        except PermissionError as err:
            msg = f"{path}: belongs to another user; try sudo -u {_owner(path)} radard {command}"
            raise NotAllowed(msg) from err
        except FileNotFoundError:
            continue
        except (OSError, ValueError) as err:
            msg = f"{path}: no radard answers ({err})"
            raise NoDaemon(msg) from err
        break
    if answer is None:
        msg = f"no radard runs here: no {paths[-1]}"
        raise NoDaemon(msg)
    if not answer.get("ok"):
        raise NoDaemon(str(answer.get("error", "refused")))
    return answer


def _panel_line(answer: Mapping[str, Any]) -> str:
    if not answer["armed"]:
        return "disarmed"
    how = "armed at home" if answer.get("mode") == "home" else "armed"
    left_s = answer.get("delay_left_s")
    return f"{how} in {left_s:.0f} s" if answer.get("panel") == "exit" else how


def _owner(path: Path) -> str:
    try:
        return path.owner()
    except (OSError, KeyError):
        return "radard"
