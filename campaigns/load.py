"""Load: one process with many radars, pages that look on and a broker that is slow.

    python campaigns/load.py --radars 2,8,32,100
    python campaigns/load.py --radars 2,6 --seconds 4 --pages 2        # the short form

A daemon with so many simulated radars at 60 Hz, each at virtual speed (a radar's frames come as
fast as its worker takes them, so that the process is always full), for --seconds of the clock;
with --speed 1 in real time. Pages hold its WebSockets open, and a broker that is stopped every
other half second takes the events of all of them. Then a reload takes half the radars away and
adds as many others. The last line is one JSON object; by number of radars: `radars`,
`cpu_per_radar` (processor seconds a second of stream of one radar), `p99_ms` (latency of a
decision), `dropped` (records that an output dropped, and frames lost), `rss_mib`,
`mib_per_radar` (beyond the first), `slowest_share` (stream time of the slowest radar over the
mean: 1 where none starves), `reload_s` (until all added radars had decided).
"""

import argparse
import json
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from campaigns.processes import Broker, Daemon, Page, ask, free_port, wait_for
from campaigns.soak import sample

_SLOW_S = 0.5
_READY_S = 600.0
"""For a hundred radars on a busy machine."""
_TICKS_HZ = 100
"""The kernel's unit of processor time (sysconf SC_CLK_TCK on Linux)."""


def sensors_of(n: int, first: int = 0) -> dict[str, dict[str, str]]:
    """Return `n` entries of `sensors`: the same scene, so that none costs more than another."""
    return {f"r{k:03d}": {"port": f"sim:human?seed={k}"} for k in range(first, first + n)}


def cpu_s(pid: int) -> float:
    """Return the processor time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_HZ


@contextmanager
def slow(broker: Broker) -> Iterator[None]:
    """Hold a broker every other half second."""
    halt = threading.Event()

    def run() -> None:
        while not halt.wait(_SLOW_S):
            broker.send(signal.SIGSTOP)
            halt.wait(_SLOW_S)
            broker.send(signal.SIGCONT)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        halt.set()
        thread.join()


def loaded(n: int, args: argparse.Namespace) -> dict[str, Any]:
    """Load a process with `n` radars; return what was measured."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        broker = stack.enter_context(Broker(folder))
        port = free_port()
        config = {
            "sensor": {"speed": args.speed},
            "sensors": sensors_of(n),
            "model": {"name": args.model},
            "output": [
                *(f"json:{folder}/out.jsonl", f"store:{folder}/store.db", broker.url),
                f"http://127.0.0.1:{port}",
            ],
            "jsonl": {"rotate_mb": 10_000.0},
        }
        daemon = stack.enter_context(Daemon(folder / "radard", config=config))
        wait_for(lambda: all_decided(daemon, config["sensors"]), "all radars", _READY_S)
        pages = [Page(port) for _ in range(args.pages)]
        for page in pages:
            stack.callback(page.close)
        with slow(broker):
            found = measured(daemon, folder / "out.jsonl", args.seconds)
        found["page_messages_min"] = min((page.n_messages for page in pages), default=0)
        found["dropped"] = dropped(port)
        found["reload_s"] = reloaded(daemon, config, n)
        return {"radars": n, **found, "exit_code": daemon.stop()}


def all_decided(daemon: Daemon, names: dict[str, Any]) -> bool:
    """Return whether every radar has decided."""
    if not daemon.is_alive:
        msg = f"it ended: {daemon.log[-500:]}"
        raise RuntimeError(msg)
    return all(daemon.status(name).get("seq") for name in names)


def measured(daemon: Daemon, out: Path, seconds: float) -> dict[str, Any]:
    """Measure for a while."""
    begun_s, begun_cpu_s, at = time.monotonic(), cpu_s(daemon.pid), out.stat().st_size
    time.sleep(seconds)
    used_s, took_s = cpu_s(daemon.pid) - begun_cpu_s, time.monotonic() - begun_s
    counts = sample(daemon.pid)
    with out.open("rb") as file:
        file.seek(at)
        lines = file.read().split(b"\n")[1:-1]
    rows = [row for line in lines if (row := json.loads(line))["type"] == "decision"]
    made: dict[str, int] = {}
    for row in rows:
        made[row["sensor"]] = made.get(row["sensor"], 0) + 1
    latency_ms = [row["latency_ms"] for row in rows] or [0.0]
    mean = len(rows) / max(1, len(made))
    return {
        "cpu_per_radar": round(used_s / max(1, len(rows)), 4),
        "p50_ms": round(float(np.percentile(latency_ms, 50)), 1),
        "p99_ms": round(float(np.percentile(latency_ms, 99)), 1),
        "decisions_a_second": round(len(rows) / took_s, 1),
        "slowest_share": round(min(made.values(), default=0) / max(1.0, mean), 2),
        "lost_frames": sum(row["dropped"] for row in rows),
        "rss_mib": round(counts.rss_kib / 1024, 1),
        "threads": counts.n_threads,
    }


def dropped(port: int) -> int:
    """Return how many records outputs have dropped, as /metrics says."""
    _, body = ask(f"http://127.0.0.1:{port}/metrics", timeout_s=60)
    lines = [line for line in body.decode().splitlines() if "dropped" in line]
    counts = [line.rpartition(" ") for line in lines if not line.startswith("#")]
    return int(
        sum(float(value) for name, _, value in counts if "sink" in name or "output" in name)
    )


def reloaded(daemon: Daemon, config: dict[str, Any], n: int) -> float:
    """Let a reload exchange half of the radars; return the seconds until all have decided."""
    kept = dict(list(config["sensors"].items())[n // 2 :])
    new = sensors_of(n // 2, first=n)
    begun_s = time.monotonic()
    daemon.configure({**config, "sensors": {**kept, **new}})
    daemon.send(signal.SIGHUP)
    wait_for(lambda: all_decided(daemon, new), "the radars that were added", _READY_S)
    return round(time.monotonic() - begun_s, 1)


def main() -> int:
    """Load it more and more."""
    about = (__doc__ or "").split("\n\n")
    parser = argparse.ArgumentParser(description=about[0], epilog=about[2])
    parser.add_argument("--radars", default="2,8,32,100", help="with commas")
    parser.add_argument("--seconds", type=float, default=30.0, help="to measure each number for")
    parser.add_argument("--pages", type=int, default=20)
    parser.add_argument("--speed", default="max", help="of the radars; 1 is real time")
    parser.add_argument("--model", default="auto")
    args = parser.parse_args()
    rows = []
    for n in map(int, args.radars.split(",")):
        rows.append(loaded(n, args))
        print(json.dumps(rows[-1]), file=sys.stderr)
    first, last = rows[0], rows[-1]
    more = max(1, last["radars"] - first["radars"])
    most = {key: [row[key] for row in rows] for key in ("radars", "cpu_per_radar", "p99_ms")}
    per_radar = round((last["rss_mib"] - first["rss_mib"]) / more, 1)
    total = {"dropped": sum(row["dropped"] for row in rows), "mib_per_radar": per_radar}
    print(json.dumps({**most, **total, "runs": rows}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
