"""The command `radard`: options to configuration, then `radard.service`."""

import json
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from radard.config import Config, load_config
from radard.errors import UsageError
from x2radar.command import Parser, new_parser, run_command

_EXAMPLES = """\
examples:
  radard --port /dev/ttyACM0                  watch a real module
  radard --port sim:demo --speed max --duration 30 -o json
  radard --port replay:night.h5 --model none  gate only
  radard config check                         is the configuration right?
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run `radard`; return its exit code."""
    return run_command("radard", _body, argv)


def _body(argv: Sequence[str]) -> int:
    if argv and argv[0] == "config":
        return _config(argv[1:])
    args = _parser().parse_args(argv)
    _start_logging(args.verbose - args.quiet, as_json=args.log_format == "json")
    if args.duration is not None and not 0 < args.duration < 1e9:
        msg = f"--duration {args.duration:g}: must be above 0, in seconds"
        raise UsageError(msg)
    config = load_config(args.config, options=_options(args))
    # Late, so that --help and wrong options answer at once.
    from radard.service import RunOptions, run  # noqa: PLC0415

    return run(
        config,
        RunOptions(
            duration_s=args.duration,
            record=args.record,
            stdout_is_terminal=sys.stdout.isatty(),
        ),
    )


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
        return json.dumps(fields)


def _start_logging(more: int, *, as_json: bool) -> None:
    handler = logging.StreamHandler(sys.stderr)
    text = logging.Formatter("%(levelname)s %(name)s: %(message)s")
    handler.setFormatter(_JsonFormatter() if as_json else text)
    logging.basicConfig(level=logging.WARNING - 10 * more, handlers=[handler], force=True)


def _options(args: Any) -> dict[str, Any]:
    sensor = {
        "port": args.port,
        "speed": args.speed,
        "on_device_loss": args.on_device_loss,
        "wait": args.wait or None,
    }
    options: dict[str, Any] = {
        "sensor": {key: value for key, value in sensor.items() if value is not None}
    }
    if args.model and args.profile:
        msg = "--model and --profile both name a model; give one"
        raise UsageError(msg)
    if args.model or args.profile:
        options["model"] = {"name": args.model or args.profile}
    if args.output:
        options["output"] = args.output
    return options


def _parser() -> Parser:
    parser = new_parser(
        "radard", "Watch a radar and raise the alarm for people, not pets.", _EXAMPLES
    )
    add = parser.add_argument
    add("--port", help="/dev/ttyACM0, a pyserial URL, sim:SCENE[?seed=1] or replay:FILE")
    add("-o", "--output", action="append", help="json, json:FILE, table or null; repeatable")
    add("--model", help="installed bundle, .onnx file, or none for the gate alone")
    add("--profile", help="fast, balanced or accurate: the bundle of that name")
    add("--speed", help="realtime, max or a factor (sim and replay)")
    add("--duration", type=float, metavar="S", help="stop after S seconds of the stream")
    add("--record", type=Path, metavar="FILE", help="keep the frames in an HDF5 recording")
    add("--config", type=Path, metavar="FILE", help="configuration file")
    add("--wait", action="store_true", help="wait for a port that is absent at start")
    add("--on-device-loss", choices=["wait", "quit"], help="when the device goes (wait)")
    add("-v", "--verbose", action="count", default=0, help="log more")
    add("-q", "--quiet", action="count", default=0, help="log less")
    add("--log-format", choices=["text", "json"], default="text", help="form of the log")
    return parser


def _config(argv: Sequence[str]) -> int:
    parser = new_parser(
        "radard config",
        "Check or show the configuration that holds.",
        "example:\n  radard config show --config /etc/radard/config.yaml\n",
    )
    parser.add_argument("what", choices=["check", "show", "schema"])
    parser.add_argument("--config", type=Path, metavar="FILE", help="configuration file")
    args = parser.parse_args(argv)
    if args.what == "schema":
        print(json.dumps(Config.model_json_schema(), indent=2))
        return 0
    config = load_config(args.config)
    if args.what == "show":
        print(yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False), end="")
    else:
        print("configuration ok")
    return 0


if __name__ == "__main__":
    sys.exit(main())
