"""What the dashboard costs: CPU with no page, one and 20; latency; weight; first paint.

    python benchmarks/bench_web.py [--seconds S] [--rounds N]

radard replays a recording of a simulated X2 at 60 Hz, again and again, in a process of its
own; pages are WebSockets of this process that take everything. Scenarios take turns, so that
what else the machine does falls on all alike. The last line is one JSON object.
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
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.client import connect

from tests.web_helpers import Running, free_port

ROOT = Path(__file__).resolve().parents[1]
STATIC = ROOT / "daemon" / "radard" / "web" / "static"
SCENARIOS = {"no output": None, "no page": 0, "1 page": 1, "20 pages": 20}


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


def measure(recording: Path, n_pages: int | None, seconds: float, speed: str) -> dict[str, Any]:
    """Run radard for a while; return its CPU share, latencies and the bytes of a page."""
    with tempfile.TemporaryDirectory() as folder:
        lines = Path(folder) / "lines.jsonl"
        argv = ["--port", f"replay:{recording}?loop=1", "--speed", speed, "-o", f"json:{lines}"]
        if n_pages is None:
            environ = {**os.environ, "RADARD_SERVICE__RUNTIME_DIR": folder}
            command = [str(Path(sys.executable).parent / "radard"), *argv]
            process = subprocess.Popen(command, env=environ, stderr=subprocess.DEVNULL)
            port = 0
        else:
            running = Running(folder, *argv, port=free_port())
            running.wait_online()
            process, port = running.process, running.port
        time.sleep(4.0)
        begun_s, used_s = time.monotonic(), cpu_s(process.pid)
        n_bytes = asyncio.run(look_on(port, n_pages or 0, seconds))
        share = (cpu_s(process.pid) - used_s) / (time.monotonic() - begun_s)
        process.terminate()
        process.wait(10)
        records = [json.loads(line) for line in lines.read_text().splitlines()]
    latency = [r["latency_ms"] for r in records if r["type"] == "decision" and r["seq"] > 4]
    return {"cpu": share, "latency_ms": latency, "bytes_per_s": n_bytes / seconds}


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
    parser.add_argument("--seconds", type=float, default=20.0, help="of every measurement (20)")
    parser.add_argument("--rounds", type=int, default=3, help="how often each is made (3)")
    args = parser.parse_args()
    cpu: dict[str, list[float]] = {name: [] for name in SCENARIOS}
    latency: dict[str, list[float]] = {name: [] for name in SCENARIOS}
    bytes_per_s = 0.0
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "human.h5"
        radard = Path(sys.executable).parent / "radard"
        make = [radard, "--port", "sim:human?seed=1", "--speed", "max", "--duration", "30"]
        subprocess.run([*make, "-o", "null", "--record", recording], check=True)
        for _ in range(args.rounds):
            for name, n_pages in SCENARIOS.items():
                found = measure(recording, n_pages, args.seconds, "1")
                cpu[name].append(found["cpu"])
                latency[name] += found["latency_ms"]
                bytes_per_s = max(bytes_per_s, found["bytes_per_s"])
                print(f"{name:>10}: CPU {100 * found['cpu']:.2f} %", flush=True)
        paint = first_paint(recording)
    result = {
        "cpu_percent_of_a_core": {k: [round(100 * x, 2) for x in v] for k, v in cpu.items()},
        "cpu_median_percent": {k: round(100 * float(np.median(v)), 2) for k, v in cpu.items()},
        "latency_ms": {
            k: {
                "n": len(v),
                "p50": round(float(np.median(v)), 2),
                "p99": round(float(np.quantile(v, 0.99)), 2),
            }
            for k, v in latency.items()
        },
        "page_bytes_per_s": round(bytes_per_s),
        "static_kb": round(sum(f.stat().st_size for f in STATIC.iterdir()) / 1000, 1),
        **paint,
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main()
