"""Soak: what grows, drifts or changes while the daemon runs and runs.

    python campaigns/soak.py --minutes 60 --stream-hours 24
    python campaigns/soak.py --minutes 0.5 --stream-hours 0.02      # the short form

Three daemons on a simulated module, at once, with a page open, an MQTT broker, a store and a
recording in use: at 60 Hz in real time for --minutes, at 200 Hz for half of them, and
--stream-hours of stream at full speed. Every 2 s the kernel's counts of each are read. Then
the recordings of the first two are replayed. The last line is one JSON object:
`rss_growth_kib_per_h` (the worst slope of resident memory behind the first third of the run;
for the third daemon per hour of stream), `fd_growth` and `thread_growth` (medians of the last
quarter less those of the second), the same for each of `runs`, and the harm, which gives exit
code 1.
"""

import contextlib
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

sys.path.insert(0, str(Path(__file__).parents[1]))

from campaigns.kept import House, records
from campaigns.processes import Daemon, end_with, parser_of
from tests.device_helpers import in_thread
from tests.waiting import free_port, wait_for

_EVERY_S = 2.0
_LAST_ENDS_S = 7200.0
_WALL = {"time", "latency_ms", "simulated", "replayed"}  # of the wall clock, or a replay


class Soaked(House):
    """A daemon that is left alone."""

    config: Mapping[str, Any] = {}

    def soak(self, seconds: float, port: str, arguments: tuple[str, ...]) -> dict[str, Any]:
        """Let it run until it ends, or for so long, with a page open; return what grew."""
        web, samples, halt = free_port(), [], threading.Event()
        self.start("--port", port, *arguments, "-o", f"http://127.0.0.1:{web}")
        daemon = self.daemon
        page = in_thread(listen, web, halt)
        wait_for(lambda: daemon.status().get("seq") or not daemon.is_alive)
        end_s = time.monotonic() + seconds
        with contextlib.suppress(OSError, KeyError):
            while time.monotonic() < end_s and daemon.is_alive:
                samples.append(sample(daemon.process.pid))
                time.sleep(_EVERY_S)
        halt.set()
        page.join()
        self.stop()
        rows = list(self.records("decision"))
        stream_h = rows[-1]["t_s"] / 3600 if "--speed" in arguments else None
        return {"decisions": len(rows), **grown(samples, stream_h)}

    def replay(self) -> None:
        """Replay the recording; note where decisions come out otherwise.

        Live ones at the very end may be missing.
        """
        out = self.root / "replay.jsonl"
        arguments = ("--port", f"replay:{self.home / 'rec.h5'}", "--speed", "max")
        Daemon(self.root / "replay", *arguments, "-o", f"json:{out}").process.wait(_LAST_ENDS_S)
        one, two = (
            [{key: row[key] for key in row.keys() - _WALL} for row in records(path, "decision")]
            for path in (self.out, out)
        )
        n_more = max(0, abs(len(one) - len(two)) - 2)
        self.found["decisions_differ"] = n_more + sum(
            a != b for a, b in zip(one, two, strict=False)
        )


def sample(pid: int) -> tuple[float, ...]:
    """Return the time, and the kernel's counts of a process: memory in KiB, files, threads.

    Raises OSError when it has ended.
    """
    proc = Path(f"/proc/{pid}")
    rows = dict(line.split(":", 1) for line in (proc / "status").read_text().splitlines())
    n_fds = sum(1 for _ in (proc / "fd").iterdir())
    return time.monotonic(), int(rows["VmRSS"].split()[0]), n_fds, int(rows["Threads"])


def listen(port: int, halt: threading.Event) -> None:
    """Listen to the daemon's WebSocket, as a page does."""
    refused = (OSError, WebSocketException, EOFError)
    while not halt.wait(0.5):
        with contextlib.suppress(*refused), connect(f"ws://127.0.0.1:{port}/ws") as line:
            while not halt.is_set():
                with contextlib.suppress(TimeoutError):
                    line.recv(timeout=1.0)


def grown(samples: Sequence[tuple[float, ...]], stream_h: float | None) -> dict[str, Any]:
    """Return what grew; by hours of stream if there are so many, else by those of the clock."""
    rows = np.array(samples)
    hours = (rows[:, 0] - rows[0, 0]) / 3600
    lasted_h = float(hours[-1])
    if stream_h is not None:
        hours *= stream_h / max(1e-9, lasted_h)
    rss = rows[:, 1]
    settled = slice(len(rows) // 3, None)
    slope = float(np.polyfit(hours[settled], rss[settled], 1)[0]) if len(rows) > 5 else 0.0
    quarter = max(1, len(rows) // 4)
    early = rows[quarter : 2 * quarter] if len(rows) > quarter else rows
    fds, threads = (np.median(rows[-quarter:], axis=0) - np.median(early, axis=0))[2:].tolist()
    return {
        "hours": round(lasted_h, 3),
        "rss_mib_first_last": [round(rss[k] / 1024, 1) for k in (settled.start, -1)],
        "rss_growth_kib_per_h": round(slope, 1),
        "fd_growth": fds,
        "thread_growth": threads,
    }


def main() -> int:
    """Soak three daemons, and print what grew."""
    parser = parser_of(__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--stream-hours", type=float, default=24.0)
    args = parser.parse_args()
    stream_s = str(round(3600 * args.stream_hours))
    recorded = ("--record", "rec.h5")
    runs: dict[str, tuple[float, str, tuple[str, ...]]] = {
        "hz60": (60 * args.minutes, "sim:demo?rate=60&run=soak", recorded),
        "hz200": (30 * args.minutes, "sim:demo?rate=200&run=soak", recorded),
        "fast": (_LAST_ENDS_S, "sim:demo?run=soak", ("--speed", "max", "--duration", stream_s)),
    }
    with ExitStack() as stack, ThreadPoolExecutor(len(runs)) as pool:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        rng = random.Random()  # noqa: S311 - nothing is drawn
        houses = [Soaked(folder / name, rng, stack) for name in runs]
        rows = list(pool.map(lambda house, run: house.soak(*run), houses, runs.values()))
        for house in houses[:2]:
            house.replay()
    worst = {
        key: max((row[key] for row in rows), key=abs)
        for key in ("rss_growth_kib_per_h", "fd_growth", "thread_growth")
    }
    harm = sum((house.found for house in houses), Counter())
    each = {name: row | house.found for name, row, house in zip(runs, rows, houses, strict=True)}
    return end_with({**worst, **harm, "runs": each})


if __name__ == "__main__":
    sys.exit(main())
