"""A port opened for a while, and its dwells in this thread: what commands work on."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from radard.config.config import Config
from radard.errors import UsageError
from radard.pipeline import Pipeline
from radard.run.components import classifier_for, make_classifier
from radard.stream.ring import Dwell, Notice
from radard.stream.source import FrameSource, open_source


@dataclass(frozen=True, slots=True)
class Listening:
    """An open port, and the pipeline for its stream with the configured model."""

    source: FrameSource
    pipeline: Pipeline

    def dwells(self, duration_s: float, *, skip_s: float = 0.0) -> Iterator[Dwell | Notice]:
        """Yield dwells and notices of `duration_s`, behind `skip_s`, in this thread."""
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
    """Open the port of a configuration and make its pipeline; close it in the end."""
    sensor = config.sensor
    if sensor.port is None:
        raise UsageError("no port: give --port /dev/ttyACM0, sim:SCENE or replay:FILE")
    classifier = make_classifier(config)
    # A device that is lost ends the work: half of it is worth nothing.
    source = open_source(sensor.port, speed=sensor.speed, wait=sensor.wait, quit_on_loss=True)
    try:
        fitting = classifier_for(source.stream, config, classifier)
        yield Listening(source, Pipeline(source.stream, config, fitting))
    finally:
        source.close()
