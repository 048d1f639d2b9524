"""Options of the commands that are configuration, and how they become it."""

import argparse
import sys
from pathlib import Path
from typing import Any

from radard.config.config import Config, load_config
from radard.config.profiles import rated
from radard.config.sink_table import FORMS
from radard.errors import UsageError
from x2radar.ports import KEYS, PORT_FORMS

PORTS = f"{PORT_FORMS}, replay:FILE or replay:FOLDER [?{'=, '.join(sorted(KEYS['replay']))}=]"
_ROWS: dict[str, dict[str, Any]] = {
    "--port": {"help": PORTS},
    "--output": {"action": "append", "metavar": "OUTPUT", "help": f"{FORMS}; repeatable"},
    "--model": {"help": "installed bundle, .onnx file, none for the gate alone, or auto"},
    "--profile": {"help": "eco, fast, balanced or accurate: bundle and settings at one go"},
    "--sensitivity": {"choices": ["low", "normal", "high"], "help": "see radard explain (normal)"},
    "--speed": {"help": "realtime, max or a factor (sim and replay)"},
    "--config": {"type": Path, "metavar": "FILE", "help": "configuration file"},
    "--state": {"type": Path, "metavar": "DIR", "help": "folder of what is kept over a restart"},
    "--wait": {"action": "store_true", "help": "wait for a port that is absent at start"},
    "--on-device-loss": {"choices": ["wait", "quit"], "help": "when the device goes (wait)"},
    "--sensor": {"metavar": "NAME", "help": "one of the configuration's sensors"},
}
LISTENING = ("--port", "--sensor", "--model", "--profile", "--speed", "--config")
JUDGING = ("--model", "--profile", "--sensitivity", "--config", "--sensor")
LONGEST_S = 86_400.0  # a day: nobody listens for longer by hand


def add_options(parser: argparse.ArgumentParser, *names: str) -> None:
    """Add options by name; without names all those of the daemon."""
    for name in names or [each for each in _ROWS if each != "--sensor"]:
        short = ("-o",) if name == "--output" else ()
        parser.add_argument(*short, name, **_ROWS[name])


def config_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return what was given, as `radard.config.config.load_config` takes it."""
    got = {name: value for name, value in vars(args).items() if value not in (None, False)}
    keys = ("port", "speed", "on_device_loss", "wait")
    sensor: dict[str, Any] = {key: got[key] for key in keys if key in got}
    if "port" in got and "sensor" in got:
        sensor["name"] = got["sensor"]
    model = {"profile": got.get("profile"), "name": got.get("model")}
    alarm = got.get("sensitivity")
    return {
        "sensor": sensor,
        "model": {key: name for key, name in model.items() if name},
        "alarm": {"sensitivity": alarm} if alarm else {},
        "service": {"state_dir": got["state"]} if "state" in got else {},
        **({"output": got["output"]} if "output" in got else {}),
    }


def check_limits(args: argparse.Namespace, **limits: tuple[float, float]) -> None:
    """Raise UsageError unless the options of these names, where given, lie within their limits."""
    for name, (least, most) in limits.items():
        value = getattr(args, name)
        if value is not None and not least <= value <= most:
            option = name.replace("_", "-")
            raise UsageError(f"--{option} {value:g}: must be {least:g} to {most:g}")


def listening_config(args: argparse.Namespace, default_port: str | None = None) -> Config:
    """Return the configuration for what is listened to; or ConfigError, UsageError."""
    config = tell_taken(load_config(args.config, options=config_options(args)))
    if args.port is None and default_port is not None and not args.sensor:
        port = rated(config.sensor.port or default_port, config.model.profile)
        own = config.sensor.model_copy(update={"port": port})
        return config.model_copy(update={"sensor": own, "sensors": {}})
    return config.of_sensor(args.sensor)


def tell_taken(config: Config) -> Config:
    """Say what comes from files that nobody named; return the configuration."""
    if config.taken:
        sys.stderr.write(f"taken from files that nobody named: {'; '.join(config.taken)}\n")
    return config


def judging_config(args: argparse.Namespace, recording: object) -> Config:
    """Return the configuration by which a sensor would judge recordings; raises likewise."""
    config = load_config(args.config, options=config_options(args), port=f"replay:{recording}")
    return config.of_sensor(args.sensor)
