"""`radard bench`: what one radar costs on this machine, and so how many of them it carries.

All is measured in one thread, over the same frames, round by round, each round with a reference
beside it: what another program takes, or a clock that changes its speed, falls out of the ratio.
"""

import argparse
import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from statistics import median

import numpy as np

from radard.commands.explain import BASIS, estimate
from radard.config.config import Config
from radard.config.options import LISTENING, LONGEST_S, add_options, check_limits, listening_config
from radard.config.profiles import front
from radard.detect.gate import DAY_S
from radard.errors import RadardError, UsageError
from radard.pipeline import Pipeline
from radard.run.components import classifier_for, make_classifier
from radard.stream.source import open_source
from x2radar.command import Parser, new_parser
from x2radar.device.assemble import FrameAssembler
from x2radar.device.transport import Transport
from x2radar.frame import Frame, StreamInfo
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.wire.codec import read_messages
from x2radar.wire.framing import PacketDecoder

_ABOUT = "Measure what one radar costs, and so how many fit."
_EXAMPLES = """\
examples:
  radard bench                         the shipped model, 60 frames a second
  radard bench --port 'sim:human?rate=200' --model none
  radard bench --port replay:night.h5 --json
  radard bench --radars 40             which profile fits, and how often it errs
"""
_SPARE = 0.7  # of the cores may go to radars; the rest is for outputs, clips and the system
_FFT_LENGTH = 4096  # any machine has its numbers in a cache
_N_FFTS = 200  # some ten milliseconds
_REFERENCE = f"{_N_FFTS} FFTs of {_FFT_LENGTH} complex numbers, per second of stream"


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    check_limits(args, duration=(4, LONGEST_S), rounds=(1, 100), radars=(1, 10_000))
    if args.radars is not None:
        return _fit(args)
    config = listening_config(args, default_port="sim:human")
    cost = measure(config, args.duration, args.rounds)
    n_cores = len(os.sched_getaffinity(0))
    all_s = cost.stages[-1].cpu_s_per_stream_s
    n_radars = int(_SPARE * n_cores / all_s)
    if args.json:
        about = {"frame_rate_hz": cost.frame_rate_hz, "model": cost.model, "cores": n_cores}
        print(json.dumps({**about, "stages": list(map(asdict, cost.stages)), "radars": n_radars}))
        return 0
    print(f"{config.sensor.port}: {cost.frame_rate_hz:g} frames a second, model {cost.model}")
    print(f"{cost.duration_s:.0f} s of it, {args.rounds} rounds, medians\n")
    print(f"{'':<34}{'CPU ms per':>12}{'of one':>9}{'times the':>11}")
    print(f"{'':<34}{'stream s':>12}{'core':>9}{'reference':>11}")
    for stage in cost.stages:
        share = f"{100 * stage.cpu_s_per_stream_s:.1f} %"
        spent_ms = 1e3 * stage.cpu_s_per_stream_s
        print(f"{stage.stage:<34}{spent_ms:12.1f}{share:>9}{stage.times_reference:11.2f}")
    print(f"\nreference: {_REFERENCE}")
    print("worst case: a gate that is always open; outputs, clips and the port are not in it")
    does = f"carries {n_radars} such radars, with 30 % to spare"
    if not n_radars:
        does = f"does not carry one radar with 30 % to spare: {100 * all_s:.0f} % of a core each"
    print(f"this machine ({_cores(n_cores)}) {does}")
    return 0


def make_parser() -> Parser:
    parser = new_parser("radard bench", _ABOUT, _EXAMPLES)
    add_options(parser, *LISTENING)
    add = parser.add_argument
    add("--duration", type=float, default=15.0, metavar="S", help="seconds of stream (15)")
    add("--rounds", type=int, default=5, metavar="N", help="measurements of each (5)")
    add("--radars", type=int, metavar="N", help="say which profile lets this computer carry N")
    add("--json", action="store_true", help="one JSON object")
    return parser


def _fit(args: argparse.Namespace) -> int:
    """Say which profile fits `args.radars` radars, errors beside it."""
    if args.model or args.profile:
        raise UsageError("--radars measures every profile; leave out --model and --profile")
    n, n_cores = args.radars, len(os.sched_getaffinity(0))
    fits = []  # each with CPU seconds of one radar, and the share of the computer that all take
    for profile in front().profiles:
        own = argparse.Namespace(**{**vars(args), "profile": profile.name})
        cost = measure(listening_config(own, default_port="sim:human"), args.duration, args.rounds)
        all_s = cost.stages[-1].cpu_s_per_stream_s
        fits.append((profile, all_s, n * all_s / n_cores))
    name = next((profile.name for profile, _, load in reversed(fits) if load <= _SPARE), None)
    if args.json:
        keys = ("profile", "cpu_s_per_stream_s", "load", "missed", "visits_with_alarm")
        rows = [(p.name, cpu_s, load, p.missed, p.pets) for p, cpu_s, load in fits]
        profiles = [dict(zip(keys, row, strict=True)) for row in rows]
        print(json.dumps({"radars": n, "cores": n_cores, "fits": name, "profiles": profiles}))
        return 0
    print(f"{'profile':<11}{'CPU ms':>7}{f'{n} radars':>12}   {'people missed':<22}pets' visits")
    print(f"{'':<11}{'a second':>8}{'take':>10}{'':<27}with an alarm")
    for p, cpu_s, load in fits:
        head = f"{p.name:<11}{1e3 * cpu_s:7.1f}{100 * load:10.0f} %"
        print(f"{head}   {estimate(p.missed):<22}{estimate(p.pets)}")
    gates = "with gates that are always open"
    print(f"\nof this computer, {_cores(n_cores)}, {gates}; errors, at least of")
    print(BASIS.format(min(profile.passages for profile in front().profiles)))
    which = f"--profile {name}" if name else "no profile"
    print(f"{which} lets it carry {n} radars with 30 % to spare")
    return 0


def _cores(n: int) -> str:
    return "1 core" if n == 1 else f"{n} cores"


@dataclass(frozen=True, slots=True)
class Stage:
    """One part of the way: CPU seconds per stream second, and how many references that is."""

    stage: str
    cpu_s_per_stream_s: float
    times_reference: float


@dataclass(frozen=True, slots=True)
class Cost:
    """What was measured: the parts along the way, the last one all of it at its worst."""

    stages: tuple[Stage, ...]
    frame_rate_hz: float  # of the stream, and
    duration_s: float  # how much of it was taken
    model: str  # name of the bundle, or none


def measure(config: Config, duration_s: float, rounds: int) -> Cost:
    """Measure every part `rounds` times, on `duration_s` of the configuration's port."""
    heard = listen(config.sensor.port or "", duration_s)
    heard_s = len(heard.frames) / heard.stream.frame_rate_hz
    classifier = classifier_for(heard.stream, config, make_classifier(config))
    open_gate = config.gate.model_copy(update={"false_alarms_per_day": DAY_S})
    always_open = config.model_copy(update={"gate": open_gate})

    def cut(settings: Config = config, *, decides: bool = False) -> Sequence[object]:
        pipeline = Pipeline(heard.stream, settings, classifier)
        dwells = pipeline.make_ring().dwells(heard.frames)
        return [pipeline.decide(dwell) for dwell in dwells] if decides else list(dwells)

    if not cut():
        msg = f"{heard_s:.1f} s of stream are too short for one window; take a longer --duration"
        raise RadardError(msg)

    work: dict[str, Callable[[], object]] = {
        **({} if heard.decode is None else {"bytes to frames": heard.decode}),
        "frames to windows": cut,
        "... and decisions, as heard": lambda: cut(decides=True),
        "... and decisions, always open": lambda: cut(always_open, decides=True),
    }
    block = np.ones(_FFT_LENGTH, np.complex128)
    # Once for every second of the stream, so that the ratio is one to a second as well.
    n_ffts = max(1, round(heard_s)) * _N_FFTS
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in work}
    for _ in range(rounds):
        reference_s = _time(lambda: [np.fft.fft(block) for _ in range(n_ffts)]) / heard_s
        for name, part in work.items():
            spent_s = _time(part) / heard_s
            spent[name].append((spent_s, spent_s / reference_s))
    stages = [Stage(name, *map(median, zip(*each, strict=True))) for name, each in spent.items()]
    parts = stages[-1:] if heard.decode is None else [stages[0], stages[-1]]
    sums = (sum(s.cpu_s_per_stream_s for s in parts), sum(s.times_reference for s in parts))
    worst = Stage("all, at its worst", *sums)
    model = classifier.bundle.name if classifier else "none"
    return Cost((*stages, worst), heard.stream.frame_rate_hz, heard_s, model)


@dataclass(frozen=True, slots=True)
class Heard:
    """Frames of a port, and what makes them of its bytes again; None for a recording."""

    stream: StreamInfo
    frames: list[Frame]
    decode: Callable[[], None] | None


class _Tap:
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


def listen(port: str, duration_s: float) -> Heard:
    """Return `duration_s` of a port's frames; raises as `measure`."""
    parsed = parse_port(port)
    if parsed.kind == "replay":
        source = open_source(port)
        n = max(1, round(duration_s * source.stream.frame_rate_hz))
        frames = list(islice(source.frames(), n))
        source.close()
        return Heard(source.stream, frames, None)
    radar = make_radar(parsed, speed=None)
    chunks: list[bytes] = []
    radar.wrap_transport(lambda inner: _Tap(inner, chunks))
    with radar:
        coming = radar.frames()
        first = next(coming)
        stream, settings = radar.stream, radar.settings
        if stream is None:
            raise RadardError(f"{port}: frames came without their stream's axis")
        frames = [first, *islice(coming, max(1, round(duration_s * stream.frame_rate_hz)) - 1)]

    def decode() -> None:
        decoder, assembler = PacketDecoder(), FrameAssembler(settings)
        for chunk in chunks:
            for message in read_messages(decoder, chunk):
                if message is not None:
                    assembler.frame(message, 0.0)

    return Heard(stream, frames, decode)


def _time(work: Callable[[], object]) -> float:
    begun_s = time.process_time()
    work()
    return max(time.process_time() - begun_s, 1e-9)
