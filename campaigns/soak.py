"""Soak: what grows, drifts or changes while the daemon runs and runs.

    python campaigns/soak.py --minutes 60 --stream-hours 24
    python campaigns/soak.py --minutes 0.5 --stream-hours 0.02      # the short form

Three daemons on a simulated module, at once, with a page open, an MQTT broker, a store and a
recording in use: at 60 Hz in real time for --minutes, at 200 Hz for half of them, and
--stream-hours of stream at full speed. Every 2 s the kernel's counts of each are read. Then
the recordings of the first two are replayed. The last line is one JSON object:
`rss_growth_kib_per_h` (the worst slope of resident memory behind the first third of the run;
for the third daemon per hour of stream), `fd_growth` and `thread_growth` (medians of the last
quarter less those of the second), `clock_drift_ppm` (stream against the clock on the wall) and
`decisions_differ` (between what was said live and the replay), `crashes` (daemons that did not end
well), and the same for each of `runs`. Exit code 1 if harm was found.
"""

import contextlib
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

sys.path.insert(0, str(Path(__file__).parents[1]))

from campaigns.outputs import Broker, Outputs, records
from campaigns.processes import Daemon, end_with, parser_of, wait_for
from tests.waiting import free_port

_EVERY_S = 2.0
_LAST_ENDS_S = 7200.0
_WALL = {"time", "latency_ms", "simulated", "replayed"}
"""What tells of the clock on the wall, or that it is a replay."""


def sample(pid: int) -> tuple[float, ...]:
    """Return the time, and the kernel's counts of a process: memory in KiB, files, threads.

    Raises OSError when it has ended.
    """
    proc = Path(f"/proc/{pid}")
    rows = dict(line.split(":", 1) for line in (proc / "status").read_text().splitlines())
    n_fds = sum(1 for _ in (proc / "fd").iterdir())
    return time.monotonic(), int(rows["VmRSS"].split()[0]), n_fds, int(rows["Threads"])


def listened(port: int, halt: threading.Event) -> int:
    """Listen to the daemon's WebSocket, as a page does; return how many messages came."""
    n, refused = 0, (OSError, WebSocketException, EOFError)
    while not halt.wait(0.5):
        with contextlib.suppress(*refused), connect(f"ws://127.0.0.1:{port}/ws") as line:
            while not halt.is_set():
                with contextlib.suppress(TimeoutError):
                    line.recv(timeout=1.0)
                    n += 1
    return n


def soaked(
    folder: Path, broker: Broker, pool: ThreadPoolExecutor, seconds: float, *arguments: str
) -> dict[str, Any]:
    """Run a daemon of the folder's name until it ends, or for so long; return its counts."""
    outputs, web, samples = Outputs(folder, broker), free_port(), []
    arguments = (*arguments, *outputs.arguments, "-o", f"http://127.0.0.1:{web}")
    daemon = Daemon(folder, *arguments, config={"sensor": {"name": folder.name}})
    halt = threading.Event()
    page = pool.submit(listened, web, halt)
    wait_for(lambda: daemon.status(folder.name).get("seq") or not daemon.is_alive, "a decision")
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and daemon.is_alive:
        try:
            samples.append(sample(daemon.process.pid))
        except (OSError, KeyError):
            break
        time.sleep(_EVERY_S)
    halt.set()
    code = daemon.stop()
    rows = list(outputs.records("decision"))
    found = {"messages_to_page": page.result(), "exit_code": code}
    found |= {"crashes": int(code != 0), "decisions": len(rows)}
    if "--speed" in arguments:
        return found | grown(samples, rows[-1]["t_s"] / 3600)
    return found | grown(samples, None) | {"clock_drift_ppm": drift_ppm(rows)}


def differs(folder: Path) -> int:
    """Replay a daemon's recording; return how many decisions come out otherwise."""
    out = folder / "replay.jsonl"
    arguments = ["--port", f"replay:{folder / 'rec.h5'}", "--speed", "max"]
    daemon = Daemon(folder / "replay", *arguments, "-o", f"json:{out}")
    daemon.process.wait(_LAST_ENDS_S)
    live, replayed = (list(records(path, "decision")) for path in (folder / "out.jsonl", out))
    return differing(live, replayed)


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


def drift_ppm(rows: Sequence[Mapping[str, Any]]) -> float:
    """Return how much faster the stream's clock runs than that on the wall, in 1e-6.

    By the least delayed decisions of each tenth of the run: what comes late says nothing.
    """
    at = [
        (row["t_s"], datetime.fromisoformat(row["time"]).timestamp() - row["t_s"]) for row in rows
    ]
    n = max(1, len(at) // 10)
    firsts = [min(at[k : k + n], key=lambda pair: pair[1]) for k in range(0, len(at) - n + 1, n)]
    if len(firsts) < 2:
        return 0.0
    slope = np.polyfit([t_s for t_s, _ in firsts], [lag_s for _, lag_s in firsts], 1)[0]
    return round(-1e6 * float(slope), 2)


def differing(live: Sequence[Mapping[str, Any]], replayed: Sequence[Mapping[str, Any]]) -> int:
    """Return how many decisions are not the same; live ones at the very end may be missing."""
    one, two = (
        [{key: row[key] for key in row.keys() - _WALL} for row in rows]
        for rows in (live, replayed)
    )
    n = min(len(one), len(two))
    n_more = max(0, len(one) - 2 - n, len(two) - 2 - n)
    return sum(a != b for a, b in zip(one, two, strict=False)) + n_more


def main() -> int:
    """Soak, and print what grew."""
    parser = parser_of(__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--stream-hours", type=float, default=24.0)
    parser.add_argument("--most-minutes", type=float, default=120.0, help="for the stream hours")
    parser.add_argument("--folder", type=Path, help="keep what was written there")
    args = parser.parse_args()
    with ExitStack() as stack:
        made = stack.enter_context(tempfile.TemporaryDirectory())
        folder = (args.folder or Path(made)).resolve()
        folder.mkdir(exist_ok=True)
        broker = Broker(folder)
        stack.callback(broker.stop)
        found = soak(folder, broker, args.minutes * 60, args.stream_hours, args.most_minutes * 60)
    return end_with(found)


def soak(
    folder: Path, broker: Broker, seconds: float, stream_h: float, most_s: float
) -> dict[str, Any]:
    """Run the three daemons and return what the last line says."""
    fast = ("--speed", "max", "--duration", str(round(stream_h * 3600)))
    timed: list[tuple[Any, ...]] = []
    for rate_hz, share in ((60, 1.0), (200, 0.5)):
        own, port = folder / f"hz{rate_hz}", f"sim:demo?rate={rate_hz}&run=soak"
        timed.append((own, seconds * share, "--port", port, "--record", str(own / "rec.h5")))
    timed.append((folder / "fast", most_s, "--port", "sim:demo?run=soak", *fast))
    with ThreadPoolExecutor(2 * len(timed)) as pool:
        ended = pool.map(lambda own: soaked(own[0], broker, pool, *own[1:]), timed)
        runs = {own[0].name: found for own, found in zip(timed, ended, strict=True)}
    for own in timed[:2]:
        runs[own[0].name]["decisions_differ"] = differs(own[0])
    worst = {
        key: max((row[key] for row in runs.values() if key in row), key=abs)
        for key in ("rss_growth_kib_per_h", "fd_growth", "thread_growth", "clock_drift_ppm")
    }
    harm = ("crashes", "decisions_differ")
    sums = {key: sum(row.get(key, 0) for row in runs.values()) for key in harm}
    return {**worst, **sums, "runs": runs}


if __name__ == "__main__":
    sys.exit(main())
