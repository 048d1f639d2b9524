"""The options that calibrate, walktest and bench share: which port to listen to."""

import argparse
from pathlib import Path

from radard.config.config import Config, load_config
from radard.config.options import PORTS
from radard.errors import UsageError

LONGEST_S = 86_400.0
"""A day: nobody listens for longer by hand."""


def check_seconds(name: str, value: float, least: float) -> None:
    """Raise UsageError unless an option in seconds is between `least` and a day."""
    if not least <= value <= LONGEST_S:
        msg = f"{name} {value:g}: must be {least:g} to {LONGEST_S:g}, in seconds"
        raise UsageError(msg)


def add_listening(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what to listen to; see `listening_config`."""
    add = parser.add_argument
    add("--port", help=PORTS)
    add("--sensor", metavar="NAME", help="one of the configuration's sensors")
    add("--model", help="installed bundle, .onnx file, or none for the gate alone")
    add("--speed", help="realtime, max or a factor (sim and replay)")
    add("--config", type=Path, metavar="FILE", help="configuration file")


def listening_config(args: argparse.Namespace, default_port: str | None = None) -> Config:
    """Return the configuration that holds for what is listened to.

    Raises ConfigError or UsageError if it is wrong, or does not say which of several sensors is
    meant.
    """
    sensor = {key: getattr(args, key) for key in ("port", "speed") if getattr(args, key)}
    if args.port and args.sensor:
        sensor["name"] = args.sensor
    options = {"sensor": sensor, "model": {"name": args.model} if args.model else {}}
    config = load_config(args.config, options=options)
    if args.port is None and default_port is not None and not args.sensor:
        own = config.sensor.model_copy(update={"port": config.sensor.port or default_port})
        return config.model_copy(update={"sensor": own, "sensors": {}})
    return config.of_sensor(args.sensor)
