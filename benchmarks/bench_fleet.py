"""How many radars a computer carries: recorded streams, replayed in real time on a few cores.

Four in ten radars replay somebody who walks, so that their gate is open; the others an empty
room. Streams are recorded first, so that simulating bodies is not what is measured. The last line
is one JSON object: `radars`, `cpu_fraction` (of the cores, while all of them run), `p99_ms` (from
a dwell's last frame to its decision), `dropped` (decisions that streams in real time would have
brought, and that did not come), `mib_per_radar` (beyond the first).

    python benchmarks/bench_fleet.py --radars 100 --seconds 60
    python benchmarks/bench_fleet.py --radars 100 --seconds 60 --services 2
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

_FIRST_S = 2.45
"""Of a stream, until its first decision at 60 Hz."""
_WARM_S = 12.0
"""Until all radars are up: what comes before is not counted."""
_OPEN_IN_TEN = 4


def main() -> None:
    """Measure one radar and many, each in a process of its own, and print both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--radars", type=int, default=100, help="of all services together")
    add("--services", type=int, default=1, help="processes that share the radars and the cores")
    add("--seconds", type=float, default=60.0, help="that are measured")
    add("--cores", type=int, default=2, help="that the process may use")
    add("--profile", default="accurate", help="of every radar")
    add("--one", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one is not None:
        print(json.dumps(measure(args.one, args.radars, args)))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for scene in ("human", "empty"):
            record(folder / f"{scene}.h5", scene)
        first = run(folder / "first", 1, args)
        shares = [len(range(k, args.radars, args.services)) for k in range(args.services)]
        with ThreadPoolExecutor() as pool:
            each = list(
                pool.map(lambda k: run(folder / str(k), shares[k], args), range(args.services))
            )
    extra_mib = (sum(one["mib"] for one in each) - first["mib"]) / max(1, args.radars - 1)
    result = {
        **{key: round(sum(one[key] for one in each), 3) for key in ("radars", "cpu_fraction")},
        "p99_ms": max(one["p99_ms"] for one in each),
        "dropped": sum(one["dropped"] for one in each),
    }
    print(json.dumps({**result, "mib_per_radar": round(extra_mib, 2)}))


def record(path: Path, scene: str) -> None:
    """Record half a minute of a scene."""
    argv = ("record", str(path), "--port", f"sim:{scene}", "--duration", "30", "--speed", "max")
    subprocess.run([sys.executable, "-m", "x2radar", *argv], check=True, capture_output=True)


def run(folder: Path, n_radars: int, args: argparse.Namespace) -> dict[str, float]:
    """Measure so many radars in a process and folder of their own."""
    folder.mkdir()
    argv = ["--one", str(folder), "--radars", str(n_radars), "--seconds", str(args.seconds)]
    argv += ["--cores", str(args.cores), "--profile", args.profile]
    done = subprocess.run(
        [sys.executable, __file__, *argv], check=True, stdout=subprocess.PIPE, text=True
    )
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    print(json.dumps(found), flush=True)
    return found


def measure(folder: Path, n_radars: int, args: argparse.Namespace) -> dict[str, float]:
    """Run the daemon in this process and read what it decided when."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: args.cores])
    # Late: libraries start their threads on the cores that they find. And numpy not before
    # radard, which tells it to have one thread, as the command does.
    from radard.config.config import load_config  # noqa: PLC0415
    from radard.config.profiles import front  # noqa: PLC0415
    from radard.run.process import Process, RunOptions  # noqa: PLC0415

    lines = folder / f"{n_radars}.jsonl"
    scenes = ["human" if k % 10 < _OPEN_IN_TEN else "empty" for k in range(n_radars)]
    sensors = {
        f"r{k}": {"port": f"replay:{folder.parent / scene}.h5?loop=1", "speed": "realtime"}
        for k, scene in enumerate(scenes)
    }
    service = {"runtime_dir": folder / "run", "state_dir": folder / "state"}
    options = {"model": {"profile": args.profile}, "service": service, "output": [f"json:{lines}"]}
    process = Process(
        load_config(environ={}, options={**options, "sensors": sensors}), RunOptions()
    )
    thread = threading.Thread(target=process.go)
    thread.start()
    time.sleep(_WARM_S)
    begun = time.monotonic(), time.process_time(), lines.stat().st_size
    time.sleep(args.seconds)
    wall_s, cpu_s = time.monotonic() - begun[0], time.process_time() - begun[1]
    end = lines.stat().st_size
    process.signals.ask("stop")
    thread.join()
    text = lines.read_bytes()[begun[2] : end].decode(errors="replace").splitlines()[1:-1]
    made = [record for record in map(json.loads, text) if record["type"] == "decision"]
    percentiles = statistics.quantiles(
        (record["latency_ms"] for record in made), n=100, method="inclusive"
    )
    profile = front().named(args.profile)
    # Where a recording begins again, the first whole dwell is longer in coming.
    due = n_radars * wall_s * (30.0 - _FIRST_S) / 30.0 / (profile.hop_s if profile else 1.0)
    return {
        "radars": n_radars,
        "cpu_fraction": round(cpu_s / wall_s / args.cores, 3),
        "p50_ms": round(percentiles[49], 1),
        "p99_ms": round(percentiles[98], 1),
        "dropped": max(0, round(due - len(made) - n_radars)),
        "open": round(statistics.mean(record["gate"] == "open" for record in made), 2),
        "mib": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
    }


if __name__ == "__main__":
    main()
