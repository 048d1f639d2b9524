"""What calibrate, walktest and bench share: a port opened for a while, and its dwells."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from radard.config.config import Config, load_config
from radard.config.options import PORTS
from radard.errors import UsageError
from radard.pipeline import Pipeline
from radard.run.components import classifier_for, make_classifier
from radard.stream.ring import Dwell, Notice
from radard.stream.source import FrameSource, open_source

LONGEST_S = 86_400.0  # a day; chosen


@dataclass(frozen=True, slots=True)
class Listening:
    """An open port, and the pipeline for its stream with the configured model."""

    source: FrameSource
    pipeline: Pipeline

    def dwells(self, duration_s: float, *, skip_s: float = 0.0) -> Iterator[Dwell | Notice]:
        """Yield the dwells and notices of `duration_s` of the stream, in this thread.

        The first `skip_s` are thrown away.
        """
        ring = self.pipeline.make_ring()
        rate_hz = self.pipeline.stream.frame_rate_hz
        first: int | None = None
        for frame in self.source.frames():
            first = frame.index if first is None else first
            at_s = (frame.index - first) / rate_hz
            if at_s >= skip_s + duration_s:
                return
            if at_s < skip_s:
                continue
            yield from ring.items(frame)


@contextmanager
def listen(config: Config) -> Iterator[Listening]:
    """Open the port of a configuration and make its pipeline; close it in the end.

    Raises UsageError if there is no port, RadardError or X2RadarError if port or model are not to
    be had, or do not fit each other.
    """
    sensor = config.sensor
    if sensor.port is None:
        msg = "no port: give --port /dev/ttyACM0, sim:SCENE or replay:FILE"
        raise UsageError(msg)
    classifier = make_classifier(config)
    # A device that is lost ends the work: half of it is worth nothing.
    source = open_source(sensor.port, speed=sensor.speed, wait=sensor.wait, quit_on_loss=True)
    try:
        fitting = classifier_for(source.stream, config, classifier)
        yield Listening(source, Pipeline(source.stream, config, fitting))
    finally:
        source.close()


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
