"""What the daemon costs: process CPU seconds per second of stream.

Recordings of simulated scenes are replayed through the whole of `radard` (reading, down-
conversion, ring, clutter, gate, tracks, features, network, decisions, output to nowhere) in
processes of their own. At full speed a short and a long replay differ in nothing but their
length, so the difference is free of start-up; in real time the kernel's count is read twice
while the daemon runs. One core; run it alone.

Without --model the bundle is a blank one: the four maps of 96 bins that trained ones take
(range decimation 8) into a small untrained network, what a trained bundle of those costs.
With --module the simulated module streams into a pseudo-terminal from another process, and
`serial_cpu_fraction_60hz` is what reading, framing and decoding add.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from radard.judge.features import MAP_FEATURES, FeatureSettings
from x2radar.frame import Frame, StreamInfo
from x2radar.modules.x2 import RadarSettings
from x2radar.recording.hdf5_writer import RecordingWriter
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import load_scene

SHORT_S = 5.0
SETTLE_S = 6.0
STILL_TIMES = 5


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


def command(port: str, model: str, speed: str, duration_s: float) -> list[str]:
    """Return how the daemon is called."""
    argv = ["--port", port, "--speed", speed, "--model", model, "-o", "null"]
    return [sys.executable, "-m", "radard", *argv, "--duration", f"{duration_s:g}"]


def environment() -> dict[str, str]:
    """Return the environment of a daemon on one core."""
    return {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def cpu_s(path: Path, *, model: str, duration_s: float) -> float:
    """Return the CPU seconds of one replay at full speed, start-up included."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        command(f"replay:{path}", model, "max", duration_s),
        check=True,
        env=environment(),
        stderr=subprocess.DEVNULL,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def fraction(path: Path, duration_s: float, *, model: str, rounds: int) -> float:
    """Return CPU seconds per stream second: best long replay less best short one."""
    long_s = min(cpu_s(path, model=model, duration_s=duration_s) for _ in range(rounds))
    short_s = min(cpu_s(path, model=model, duration_s=SHORT_S) for _ in range(rounds))
    return (long_s - short_s) / (duration_s - SHORT_S)


def realtime_fraction(port: str, duration_s: float, *, model: str) -> float:
    """Return CPU seconds per second of a daemon in real time, once it has settled."""
    process = subprocess.Popen(
        command(port, model, "realtime", SETTLE_S + duration_s + 60),
        env=environment(),
        stderr=subprocess.DEVNULL,
    )
    try:
        time.sleep(SETTLE_S)
        first_s, began_s = threads_cpu_s(process.pid), time.monotonic()
        time.sleep(duration_s)
        used_s = threads_cpu_s(process.pid) - first_s
        return used_s / (time.monotonic() - began_s)
    finally:
        process.terminate()
        process.wait()


def threads_cpu_s(pid: int) -> float:
    """Return the CPU seconds of all threads of a process that are alive, to the microsecond."""
    tasks = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(task.read_text().split()[0]) for task in tasks) / 1e9


def serial_fraction(scene: str, duration_s: float, *, model: str) -> float:
    """Return the same of a daemon on a pseudo-terminal, behind it a simulated module."""
    with subprocess.Popen(
        [sys.executable, "-m", "x2radar", "simulate", "--scene", scene, "--pty"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as module:
        assert module.stdout is not None
        try:
            port = module.stdout.readline().split()[-1]
            return realtime_fraction(port, duration_s, model=model)
        finally:
            module.terminate()


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="thesis_dog")
    parser.add_argument("--model", help="bundle (a blank one of 96 bins)")
    parser.add_argument("--model-200hz", help="bundle for 200 Hz (that of --model)")
    parser.add_argument("--duration", type=float, default=65.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--realtime", type=float, default=30.0, help="seconds in real time")
    parser.add_argument("--module", action="store_true", help="also on a pseudo-terminal")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = args.model or blank(folder)
        busy = record(folder, args.scene, 60, args.duration)
        fast = record(folder, args.scene, 200, args.duration)
        # A closed gate costs so little that it takes longer to tell from start-up.
        still_s = STILL_TIMES * args.duration
        still = record(folder, "empty", 60, still_s)
        length_s, rounds = args.duration, args.rounds
        model_200hz = args.model_200hz or model
        out = {
            "cpu_fraction_60hz": fraction(busy, length_s, model=model, rounds=rounds),
            "cpu_fraction_200hz": fraction(fast, length_s, model=model_200hz, rounds=rounds),
            "cpu_fraction_200hz_gate_only": fraction(fast, length_s, model="none", rounds=rounds),
            "cpu_fraction_gate_closed": fraction(still, still_s, model=model, rounds=rounds),
        }
        if args.realtime:
            for key, path in (("60hz", busy), ("gate_closed", still)):
                port = f"replay:{path}?loop=1"
                out[f"realtime_cpu_fraction_{key}"] = realtime_fraction(
                    port, args.realtime, model=model
                )
        if args.module:
            out["serial_cpu_fraction_60hz"] = serial_fraction(
                args.scene, args.realtime, model=model
            )
    print(json.dumps({key: round(value, 5) for key, value in out.items()}))


def blank(folder: Path) -> str:
    """Make the blank bundle."""
    # Late: it needs onnx, which is not installed with the daemon.
    from blank_bundle import write_blank_bundle  # noqa: PLC0415

    settings = FeatureSettings(range_decimation=8, clutter="removed")
    return str(write_blank_bundle(folder, "blank", settings, MAP_FEATURES))


if __name__ == "__main__":
    main()
