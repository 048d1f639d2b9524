"""Options of the daemon's command line that are configuration, and how they become it."""

import argparse
from pathlib import Path
from typing import Any

from radard.config.sink_table import FORMS
from radard.errors import UsageError
from x2radar.ports import KEYS, PORT_FORMS

PORTS = f"{PORT_FORMS}, replay:FILE or replay:FOLDER [?{'=, '.join(sorted(KEYS['replay']))}=]"
"""What --port may be, for help."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that configuration can hold as well, and --config."""
    add = parser.add_argument
    add("--port", help=PORTS)
    add("-o", "--output", action="append", metavar="OUTPUT", help=f"{FORMS}; repeatable")
    add("--model", help="installed bundle, .onnx file, none for the gate alone, or auto")
    add("--profile", help="fast, balanced or accurate: the bundle of that name")
    add("--sensitivity", choices=["low", "normal", "high"], help="see radard explain (normal)")
    add("--speed", help="realtime, max or a factor (sim and replay)")
    add("--config", type=Path, metavar="FILE", help="configuration file")
    add("--state", type=Path, metavar="DIR", help="folder of what is kept over a restart")
    add("--wait", action="store_true", help="wait for a port that is absent at start")
    add("--on-device-loss", choices=["wait", "quit"], help="when the device goes (wait)")


def config_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return what was given, as `radard.config.config.load_config` takes it.

    Raises UsageError if --model and --profile are both given.
    """
    if args.model and args.profile:
        msg = "--model and --profile both name a model; give one"
        raise UsageError(msg)
    given = {
        "sensor": {
            "port": args.port,
            "speed": args.speed,
            "on_device_loss": args.on_device_loss,
            "wait": args.wait or None,
        },
        "model": {"name": args.model or args.profile},
        "alarm": {"sensitivity": args.sensitivity},
        "service": {"state_dir": args.state},
    }
    options: dict[str, Any] = {
        section: {key: value for key, value in values.items() if value is not None}
        for section, values in given.items()
    }
    if args.output:
        options["output"] = args.output
    return options


def add_judging(parser: argparse.ArgumentParser) -> None:
    """Add the options of `config_options` that judging recordings takes."""
    add = parser.add_argument
    add("--model", help="installed bundle, .onnx file, none for the gate alone, or auto")
    add("--profile", help="fast, balanced or accurate: the bundle of that name")
    add("--sensitivity", choices=["low", "normal", "high"], help="see radard explain (normal)")
    add("--config", type=Path, metavar="FILE", help="configuration file")
    add("--sensor", metavar="NAME", help="one of the configuration's sensors")
    defaults = {"port": None, "output": None, "speed": None, "wait": None, "on_device_loss": None}
    defaults["state"] = None
    parser.set_defaults(**defaults)
