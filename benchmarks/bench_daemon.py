"""What the daemon costs: process CPU seconds per second of stream.

Recordings of simulated scenes are replayed through the whole of `radard` (reading, down-
conversion, ring, clutter, gate, tracks, features, network, decisions, output to nowhere) in
processes of their own. A short and a long replay differ in nothing but their length, so the
difference is free of start-up. One core; run it alone.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from x2radar.frame import Frame, StreamInfo
from x2radar.recording_writer import RecordingWriter
from x2radar.settings import RadarSettings
from x2radar.sim.scene import load_scene
from x2radar.sim.stream import EchoStream

SHORT_S = 5.0


def record(folder: Path, scene: str, rate_hz: int, duration_s: float) -> Path:
    """Record a scene's RF frames."""
    path = folder / f"{scene}-{rate_hz}-{duration_s:g}.h5"
    stream = EchoStream(load_scene(scene), 1, RadarSettings.for_frame_rate(rate_hz))
    info = StreamInfo(stream.axis, float(rate_hz), scene)
    with RecordingWriter(path, info) as writer:
        last = np.zeros(stream.axis.n_range, np.float32)
        for k in range(round(duration_s * rate_hz)):
            frame = stream.next()
            last = last if frame is None else frame
            writer.write(Frame(last, k + 1, k, 0, False, stream.axis))
    return path


def cpu_s(path: Path, *, model: str, speed: str, duration_s: float) -> float:
    """Return the CPU seconds of one replay."""
    argv = ["--port", f"replay:{path}", "--speed", speed, "--model", model, "-o", "null"]
    argv += ["--duration", f"{duration_s:g}"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-m", "radard.cli", *argv],
        check=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stderr=subprocess.DEVNULL,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def fraction(path: Path, duration_s: float, *, model: str, speed: str, rounds: int) -> float:
    """Return CPU seconds per stream second, best of some rounds."""
    best = float("inf")
    for _ in range(rounds):
        kwargs = {"model": model, "speed": speed}
        long_s = cpu_s(path, duration_s=duration_s, **kwargs)
        short_s = cpu_s(path, duration_s=SHORT_S, **kwargs)
        best = min(best, (long_s - short_s) / (duration_s - SHORT_S))
    return best


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="seed_dog")
    parser.add_argument("--model", default="seed")
    parser.add_argument("--duration", type=float, default=65.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--realtime", type=float, default=25.0, help="seconds in real time")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        busy = record(folder, args.scene, 60, args.duration)
        fast = record(folder, args.scene, 200, args.duration)
        still = record(folder, "empty", 60, args.duration)
        kwargs = {"rounds": args.rounds, "speed": "max"}
        out = {
            "cpu_fraction_60hz": fraction(busy, args.duration, model=args.model, **kwargs),
            "cpu_fraction_200hz": fraction(fast, args.duration, model="none", **kwargs),
            "cpu_fraction_gate_closed": fraction(still, args.duration, model=args.model, **kwargs),
            "realtime_cpu_fraction_60hz": fraction(
                busy, args.realtime, model=args.model, rounds=1, speed="realtime"
            ),
        }
    print(json.dumps({key: round(value, 5) for key, value in out.items()}))


if __name__ == "__main__":
    main()
