"""What one radar costs: CPU time of each part of the way, over the same frames.

All is measured in one thread, round by round, each round with a reference beside it, so that
what another program takes or a clock that changes its speed falls out of the ratio.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from statistics import median

import numpy as np

from radard.config.config import Config
from radard.detect.gate import DAY_S
from radard.errors import RadardError
from radard.judge.classifier import Classifier
from radard.pipeline import Pipeline
from radard.run.components import classifier_for, make_classifier
from radard.stream.ring import Dwell
from radard.stream.source import open_source
from x2radar.device.assemble import FrameAssembler
from x2radar.device.transport import Transport
from x2radar.frame import Frame, StreamInfo
from x2radar.ports import make_radar, parse_port
from x2radar.wire.protocol import Received, Session

_FFT_LENGTH = 4096  # chosen: of a size that any machine does in its cache
_N_FFTS = 200  # chosen: some ten milliseconds
_REFERENCE = f"{_N_FFTS} FFTs of {_FFT_LENGTH} complex numbers, per second of stream"


@dataclass(frozen=True, slots=True)
class TimedPart:
    """One part: its name, CPU seconds per stream second, and how many references that is."""

    name: str
    cpu_s: float
    ratio: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What was measured."""

    stages: tuple[TimedPart, ...]  # along the way; the last one is all of it at its worst
    frame_rate_hz: float  # of the stream, and
    duration_s: float  # how much of it was taken
    model: str  # name of the bundle, or none
    reference: str = _REFERENCE  # what the ratios are to

    @property
    def all_s(self) -> float:
        """CPU seconds of one radar per second of its stream, at the worst."""
        return self.stages[-1].cpu_s


@dataclass(frozen=True, slots=True)
class _Heard:
    """Frames of a port, and the bytes that they came in; None for a recording."""

    stream: StreamInfo
    frames: list[Frame]
    chunks: list[bytes] | None
    assembler: Callable[[], FrameAssembler] | None


def measured(config: Config, duration_s: float, rounds: int) -> Cost:
    """Measure every part `rounds` times, on `duration_s` of the stream of a configuration's port.

    Raises RadardError or X2RadarError if port or model are not to be had, or the stream is too
    short.
    """
    classifier = make_classifier(config)
    heard = _heard(config.sensor.port or "", duration_s)
    classifier = classifier_for(heard.stream, config, classifier)
    heard_s = len(heard.frames) / heard.stream.frame_rate_hz
    open_gate = config.gate.model_copy(update={"false_alarms_per_day": DAY_S})
    always_open = config.model_copy(update={"gate": open_gate})
    dwells = sum(1 for _ in _dwells(_pipeline(heard, config, classifier), heard))
    if dwells == 0:
        msg = f"{heard_s:.1f} s of stream are too short for one window; take a longer --duration"
        raise RadardError(msg)
    work: dict[str, Callable[[], None]] = {}
    if heard.chunks is not None:
        work["bytes to frames"] = lambda: _decode(heard)
    work["frames to windows"] = lambda: _cut(heard, _pipeline(heard, config, classifier))
    work["... and decisions, as heard"] = lambda: _decide(heard, config, classifier)
    work["... and decisions, always open"] = lambda: _decide(heard, always_open, classifier)
    cpu_s: dict[str, list[float]] = {name: [] for name in work}
    ratios: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(rounds):
        # Once for every second of the stream, so that the ratio is one to a second as well.
        reference_s = _timed(lambda: _reference(max(1, round(heard_s)))) / heard_s
        for name, part in work.items():
            spent_s = _timed(part) / heard_s
            cpu_s[name].append(spent_s)
            ratios[name].append(spent_s / reference_s)
    stages = [TimedPart(name, median(cpu_s[name]), median(ratios[name])) for name in work]
    parts = [stages[0], stages[-1]] if heard.chunks is not None else [stages[-1]]
    stages.append(
        TimedPart("all, at its worst", sum(s.cpu_s for s in parts), sum(s.ratio for s in parts))
    )
    return Cost(
        stages=tuple(stages),
        frame_rate_hz=heard.stream.frame_rate_hz,
        duration_s=heard_s,
        model=classifier.bundle.name if classifier else "none",
    )


class _Ear:
    """A transport that keeps what it reads."""

    def __init__(self, inner: Transport, chunks: list[bytes]) -> None:
        self._inner = inner
        self._chunks = chunks
        self.is_usb = bool(getattr(inner, "is_usb", False))
        self.write, self.close = inner.write, inner.close

    def read(self, timeout_s: float) -> bytes:
        data = self._inner.read(timeout_s)
        self._chunks.append(data)
        return data


def _heard(port: str, duration_s: float) -> _Heard:
    spec = parse_port(port)
    if spec.scheme == "replay":
        source = open_source(port)
        n = max(1, round(duration_s * source.stream.frame_rate_hz))
        frames = list(islice(source.frames(), n))
        source.close()
        return _Heard(source.stream, frames, None, None)
    radar = make_radar(spec, speed=None)
    chunks: list[bytes] = []
    radar.wrap_transport(lambda connect: lambda: _Ear(connect(), chunks))
    with radar:
        stream_frames = radar.frames()
        first = next(stream_frames)
        stream = radar.stream
        assert stream is not None  # noqa: S101 - known with the first frame
        n = max(1, round(duration_s * stream.frame_rate_hz))
        frames = [first, *islice(stream_frames, n - 1)]
        settings = radar.settings
    return _Heard(stream, frames, chunks, lambda: FrameAssembler(settings))


def _pipeline(heard: _Heard, config: Config, classifier: Classifier | None) -> Pipeline:
    return Pipeline(heard.stream, config, classifier)


def _dwells(pipeline: Pipeline, heard: _Heard) -> Iterator[Dwell]:
    ring = pipeline.make_ring()
    for frame in heard.frames:
        yield from (item for item in ring.items(frame) if isinstance(item, Dwell))


def _decode(heard: _Heard) -> None:
    assert heard.chunks is not None  # noqa: S101 - asked for only then
    assert heard.assembler is not None  # noqa: S101 - likewise
    session, assembler = Session(), heard.assembler()
    for chunk in heard.chunks:
        session.receive(chunk)
        while (event := session.next_event()) is not None:
            if isinstance(event, Received):
                assembler.frame(event.message, 0.0)


def _cut(heard: _Heard, pipeline: Pipeline) -> None:
    for _ in _dwells(pipeline, heard):
        pass


def _decide(heard: _Heard, config: Config, classifier: Classifier | None) -> None:
    pipeline = _pipeline(heard, config, classifier)
    for dwell in _dwells(pipeline, heard):
        pipeline.decide(dwell)


def _reference(n: int) -> None:
    block = np.ones(_FFT_LENGTH, np.complex128)
    for _ in range(n * _N_FFTS):
        np.fft.fft(block)


def _timed(work: Callable[[], None]) -> float:
    begun_s = time.process_time()
    work()
    return max(time.process_time() - begun_s, 1e-9)
