"""What the dashboard costs: CPU and latency with no page, one and 20; weight; first paint.

    python benchmarks/bench_web.py [--seconds S] [--rounds N] [--repeats N] [--speed X]

radard replays a recording of a simulated X2 at 60 Hz, again and again, in a process of its
own; pages are WebSockets of this process that take everything. In each repeat one daemon runs,
and pages come and go before it: every round has a while with none, one and 20 of them, each
round in another order, so that what else the machine does falls on all alike. A repeat's last
part is a daemon without a dashboard. The last line is one JSON object.
"""

import argparse
import asyncio
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.client import connect

from tests.web_helpers import Running, free_port

ROOT = Path(__file__).resolve().parents[1]
STATIC = ROOT / "daemon" / "radard" / "web" / "static"
ALONE = "no output"
PAGES = {"no page": 0, "1 page": 1, "20 pages": 20}
_SETTLE_S = 2.0
"""Pages that have come or gone are over with that; what falls into it is not counted."""
_REPLICATES = 2000


def cpu_s(pid: int) -> float:
    """Return the CPU time that a process has used, in seconds."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def look_on(port: int, n: int, seconds: float) -> int:
    """Hold `n` pages open; return how many bytes each got on the average."""

    async def page() -> int:
        taken = drawn = 0
        async with connect(f"ws://127.0.0.1:{port}/ws", proxy=None) as socket:
            await socket.send('{"pictures": true}')
            end_s = time.monotonic() + seconds
            while (left_s := end_s - time.monotonic()) > 0:
                try:
                    data = await asyncio.wait_for(socket.recv(), left_s)
                except TimeoutError:
                    break
                taken += len(data)
                if isinstance(data, bytes):
                    drawn += 1
                    if drawn % 6 == 0:
                        await socket.send(json.dumps({"drawn": drawn}))
        return taken

    if n == 0:
        await asyncio.sleep(seconds)
        return 0
    return sum(await asyncio.gather(*(page() for _ in range(n)))) // n


@dataclass
class Found:
    """What was measured in one scenario of one repeat."""

    cpu: list[float] = field(default_factory=list)
    latency_ms: list[list[float]] = field(default_factory=list)
    load: list[float] = field(default_factory=list)
    bytes_per_s: float = 0.0


def arguments(recording: Path, lines: Path, speed: str) -> list[str]:
    """Return how radard is started."""
    return ["--port", f"replay:{recording}?loop=1", "--speed", speed, "-o", f"json:{lines}"]


def latencies(lines: Path, first: int) -> list[float]:
    """Return the latencies (ms) of the decisions behind the first so many lines."""
    rows = [json.loads(line) for line in lines.read_text().splitlines()[first:]]
    return [r["latency_ms"] for r in rows if r["type"] == "decision" and r["seq"] > 4]


def n_lines(lines: Path) -> int:
    """Return how many whole lines there are."""
    return lines.read_text().count("\n") if lines.exists() else 0


@dataclass(frozen=True)
class Daemon:
    """A daemon that runs: its process, its records, where its dashboard listens."""

    pid: int
    lines: Path
    port: int = 0


def watch(found: Found, daemon: Daemon, n_pages: int, seconds: float) -> None:
    """Measure a daemon for a while with some pages open."""
    pid, lines = daemon.pid, daemon.lines

    async def look() -> None:
        pages = asyncio.create_task(look_on(daemon.port, n_pages, _SETTLE_S + seconds))
        await asyncio.sleep(_SETTLE_S)
        first, begun_s, used_s = n_lines(lines), time.monotonic(), cpu_s(pid)
        found.bytes_per_s = await pages / (_SETTLE_S + seconds)
        found.cpu.append((cpu_s(pid) - used_s) / (time.monotonic() - begun_s))
        found.latency_ms.append(latencies(lines, first))
        found.load.append(os.getloadavg()[0])

    asyncio.run(look())


def repeat(recording: Path, seconds: float, rounds: int, speed: str) -> dict[str, Found]:
    """Return what one daemon with pages, and then one without a dashboard, were measured at."""
    found = {name: Found() for name in (*PAGES, ALONE)}
    with tempfile.TemporaryDirectory() as folder:
        lines = Path(folder) / "lines.jsonl"
        running = Running(folder, *arguments(recording, lines, speed), port=free_port())
        running.wait_online()
        time.sleep(4.0)
        daemon, names = Daemon(running.process.pid, lines, running.port), list(PAGES)
        for k in range(rounds):
            for name in names[k % 3 :] + names[: k % 3]:
                watch(found[name], daemon, PAGES[name], seconds)
        running.end()
    with tempfile.TemporaryDirectory() as folder:
        lines = Path(folder) / "lines.jsonl"
        environ = {**os.environ, "RADARD_SERVICE__RUNTIME_DIR": folder}
        command = [str(Path(sys.executable).parent / "radard")]
        command += arguments(recording, lines, speed)
        process = subprocess.Popen(command, env=environ, stderr=subprocess.DEVNULL)
        time.sleep(6.0)
        watch(found[ALONE], Daemon(process.pid, lines), 0, seconds)
        process.terminate()
        process.wait(10)
    return found


def p99(blocks: list[list[float]]) -> dict[str, Any]:
    """Return median and 99th percentile of all decisions, with a bootstrap over blocks."""
    whole = np.concatenate(blocks)
    rng = np.random.default_rng(0)
    drawn = [
        np.quantile(
            np.concatenate([blocks[i] for i in rng.integers(len(blocks), size=len(blocks))]), 0.99
        )
        for _ in range(_REPLICATES)
    ]
    low, high = np.quantile(drawn, (0.025, 0.975))
    return {
        "n": len(whole),
        "p50": round(float(np.median(whole)), 2),
        "p99": round(float(np.quantile(whole, 0.99)), 2),
        "p99_low": round(float(low), 2),
        "p99_high": round(float(high), 2),
        "max": round(float(whole.max()), 2),
    }


def first_paint(recording: Path) -> dict[str, Any]:
    """Return first contentful paint (ms) of cold loads, and what was fetched (kB)."""
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
    try:
        from playwright.sync_api import sync_playwright  # noqa: PLC0415
    except ImportError:
        return {}
    if chromium is None:
        return {}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        running = Running(folder, "--port", f"replay:{recording}?loop=1", "--speed", "1")
        running.wait_online()
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        paints, fetched = [], 0.0
        for _ in range(7):
            page = browser.new_context().new_page()
            page.goto(running.base)
            page.wait_for_selector("#page .card")
            paints.append(
                page.evaluate(
                    "performance.getEntriesByName('first-contentful-paint')[0].startTime"
                )
            )
            fetched = page.evaluate(
                """performance.getEntriesByType('resource').concat(
                performance.getEntriesByType('navigation'))
                .reduce((sum, e) => sum + e.transferSize, 0)"""
            )
            page.context.close()
        browser.close()
        running.end()
    return {
        "first_paint_ms_median": round(float(np.median(paints)), 1),
        "first_paint_ms_max": round(max(paints), 1),
        "fetched_kb": round(fetched / 1000, 1),
    }


def main() -> None:
    """Measure everything and print it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    add = parser.add_argument
    add("--seconds", type=float, default=15.0, help="of every measurement (15)")
    add("--rounds", type=int, default=6, help="of none, one and 20 pages, a repeat (6)")
    add("--repeats", type=int, default=3, help="each with a daemon of its own (3)")
    add("--speed", default="1", help="of the replay: 4 gives four times the decisions (1)")
    args = parser.parse_args()
    made: list[dict[str, Found]] = []
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "human.h5"
        radard = Path(sys.executable).parent / "radard"
        make = [radard, "--port", "sim:human?seed=1", "--speed", "max", "--duration", "30"]
        subprocess.run([*make, "-o", "null", "--record", recording], check=True)
        for k in range(args.repeats):
            made.append(repeat(recording, args.seconds, args.rounds, args.speed))
            for name, found in made[-1].items():
                p = p99(found.latency_ms)
                print(
                    f"repeat {k + 1}, {name:>9}: CPU {100 * np.median(found.cpu):.2f} %, "
                    f"p50 {p['p50']} ms, p99 {p['p99']} ms of {p['n']}, "
                    f"load {np.mean(found.load):.1f}",
                    flush=True,
                )
        paint = first_paint(recording)
    blocks = {name: [b for m in made for b in m[name].latency_ms] for name in (*PAGES, ALONE)}
    cpu = {name: [x for m in made for x in m[name].cpu] for name in blocks}
    load = [x for m in made for found in m.values() for x in found.load]
    result = {
        "load": [round(min(load), 1), round(float(np.median(load)), 1), round(max(load), 1)],
        "speed": args.speed,
        "cpu_median_percent": {k: round(100 * float(np.median(v)), 2) for k, v in cpu.items()},
        "latency_ms": {name: p99(rows) for name, rows in blocks.items()},
        "p99_ms_of_each_repeat": {
            name: [p99(m[name].latency_ms)["p99"] for m in made] for name in blocks
        },
        "page_bytes_per_s": round(made[-1]["1 page"].bytes_per_s),
        "static_kb": round(sum(f.stat().st_size for f in STATIC.iterdir()) / 1000, 1),
        **paint,
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()
