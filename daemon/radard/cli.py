"""The command `radard`: the daemon itself, or one of its subcommands."""

import argparse
import json
import logging
import sys
import textwrap
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from radard.config.config import Config, found_file, load_config
from radard.config.directories import demo_state
from radard.config.options import add_options, config_options
from radard.config.sink_table import FORMS
from radard.errors import ConfigError, UsageError
from x2radar.command import Parser, installed_version, run_command
from x2radar.manual import add_manual
from x2radar.recording.registry import check_name

_SHORT = """\
usage: radard --port PORT [options]    watch a radar; alarm for people, not pets
       radard COMMAND [options]        see radard COMMAND --help

  --port /dev/ttyACM0 | auto | URL | sim:SCENE | replay:FILE
{outputs}
  --model NAME | FILE | none     --profile eco | fast | balanced | accurate
  --sensitivity low|normal|high  --config FILE  --duration S  --speed max
  --record FILE --state DIR --wait --on-device-loss wait|quit --log-format json
  --help-all: all  --version  --debug  --print-man  --print-completion zsh -v -q

"""
_EPILOG = """\
{commands}examples:
  radard --port sim:demo --speed max --duration 30 -o json
  radard --config house.yaml                        several radars, its sensors:
configuration, later wins: built-in, /etc/radard/config.yaml, ./config.yaml,
--config, RADARD_SECTION__KEY, options. TERM, INT end; HUP reloads; USR1 dumps.
"""
_COMMANDS = {
    "calibrate": "learn a room",
    "walktest": "what it sees",
    "explain": "sensitivities",
    "detect": "judge files",
    "why": "one moment",
    "status": "what it does",
    "health": "is it well?",
    "top": "watch it live",
    "events": "what happened",
    "fleet": "all of them",
    "arm": "alarms on",
    "disarm": "alarms off",
    "ack": "end an alarm",
    "test-alarm": "try outputs",
    "config": "check, show",
    "setup": "install it",
    "diag": "for trouble",
    "bench": "how many fit",
}
"""What each does in a few words."""
_CONTROL = ("health", "status", "arm", "disarm", "ack", "test-alarm")
"""Those of `radard.commands.control`, which is told which."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run `radard`; return its exit code."""
    return run_command("radard", _body, argv)


def _body(argv: Sequence[str]) -> int:
    if argv and argv[0] in _COMMANDS:
        module, names = _place(argv[0])
        code: int = module.run(argv[1:], *names)
        return code
    args = _parser().parse_args(argv)
    _start_logging(args.verbose - args.quiet, as_json=args.log_format == "json")
    if args.duration is not None and not 0 < args.duration < 1e9:
        raise UsageError(f"--duration {args.duration:g}: must be above 0, in seconds")
    if args.record is not None:
        check_name(args.record, "hdf5")
    options = config_options(args)

    found = found_file() if args.config is None else None

    def load() -> Config:
        if found is not None and not found.is_file():
            raise ConfigError(f"{found}: is gone, and all was read from there")
        return demo_state(load_config(args.config, options=options))

    config = load()
    # Late, so that --help and wrong options answer at once.
    from radard.run.process import run  # noqa: PLC0415
    from radard.run.sensor import RunOptions  # noqa: PLC0415

    is_terminal = sys.stdout.isatty()
    run_options = RunOptions(
        duration_s=args.duration, record=args.record, stdout_is_terminal=is_terminal, reload=load
    )
    return run(config, run_options)


def whole_parser() -> Parser:
    """Return the parser with every subcommand in it, as man page and completion need it."""
    parser = _parser()
    commands = parser.add_subparsers(metavar="COMMAND")
    for name, text in _COMMANDS.items():
        module, names = _place(name)
        sub: Parser = module.make_parser(*names)
        about = {key: getattr(sub, key) for key in ("prog", "description", "epilog")}
        commands.add_parser(name, help=text, parents=[sub], add_help=False, **about)
    return parser


def _place(name: str) -> tuple[ModuleType, tuple[str, ...]]:
    """Return a subcommand's module, and what its `run` and `make_parser` take besides."""
    file = {"setup": "setup.command", **dict.fromkeys(_CONTROL, "control")}.get(name, name)
    module = import_module(f"radard.commands.{file}")
    return module, (name,) if name in _CONTROL else ()


class _JsonFormatter(logging.Formatter):
    """One JSON object a line."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line of one log record."""
        fields = {
            "time": self.formatTime(record),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            fields["traceback"] = self.formatException(record.exc_info)
        return json.dumps(fields)


def _start_logging(more: int, *, as_json: bool) -> None:
    handler = logging.StreamHandler(sys.stderr)
    text = logging.Formatter("%(levelname)s %(name)s: %(message)s")
    handler.setFormatter(_JsonFormatter() if as_json else text)
    logging.basicConfig(level=logging.WARNING - 10 * more, handlers=[handler], force=True)
    # Where the dashboard listens is news to everybody who has not asked for silence.
    logging.getLogger("radard.dashboard").setLevel(logging.INFO if more >= 0 else logging.NOTSET)


class _ShortHelp(argparse.Action):
    """Print what fits a screen, and end."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
        outputs = textwrap.indent(textwrap.fill(f"-o {FORMS}; repeatable", 75), "     ")[3:]
        print(_SHORT.format(outputs=outputs), parser.epilog, sep="", end="")
        parser.exit()


def _command_list() -> str:
    """Return the subcommands, three in a line."""
    cells = [f"  {name:<11}{text:<13}" for name, text in _COMMANDS.items()]
    rows = ("".join(cells[k : k + 3]).rstrip() for k in range(0, len(cells), 3))
    return "\n".join(("commands:", *rows, ""))


def _parser() -> Parser:
    parser = Parser(
        prog="radard",
        description="Watch a radar and raise the alarm for people, not pets.",
        epilog=_EPILOG.format(commands=_command_list()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        add_help=False,
    )
    parser.words = tuple(_COMMANDS)
    add = parser.add_argument
    add("-h", "--help", action=_ShortHelp, nargs=0, help="the most of it, on one screen")
    add("--help-all", action="help", help="show this help message and exit")
    add("--version", action="version", version=f"%(prog)s {installed_version()}")
    add("--debug", action="store_true", help="show a traceback with errors")
    add_options(parser)
    add("--duration", type=float, metavar="S", help="stop after S seconds of the stream")
    add("--record", type=Path, metavar="FILE", help="keep the frames in an HDF5 recording")
    add("-v", "--verbose", action="count", default=0, help="log more")
    add("-q", "--quiet", action="count", default=0, help="log less")
    add("--log-format", choices=["text", "json"], default="text", help="form of the log")
    add_manual(parser, whole_parser)
    return parser
