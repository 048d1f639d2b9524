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
`decisions_differ` (between what was said live and the replay), and the same for each of `runs`.
"""

import argparse
import json
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from campaigns.processes import Broker, Daemon, Page, decisions, free_port, wait_for

_EVERY_S = 2.0
_LAST_ENDS_S = 7200.0


@dataclass(frozen=True, slots=True)
class Sample:
    """The kernel's counts of a process."""

    time_s: float
    rss_kib: int
    n_fds: int
    n_threads: int


def sample(pid: int) -> Sample:
    """Return the counts of a process; raises OSError when it has ended."""
    proc = Path(f"/proc/{pid}")
    rows = dict(line.split(":", 1) for line in (proc / "status").read_text().splitlines())
    n_fds = sum(1 for _ in (proc / "fd").iterdir())
    rss_kib = int(rows["VmRSS"].split()[0])
    return Sample(time.monotonic(), rss_kib, n_fds, int(rows["Threads"]))


class Soaked:
    """One daemon, and what was counted of it."""

    def __init__(self, name: str, folder: Path, broker: Broker, port: str, *options: str) -> None:
        self.name = name
        self.samples: list[Sample] = []
        self.folder = folder / name
        web = free_port()
        outputs = [
            f"json:{self.folder}/out.jsonl",
            f"store:{self.folder}/store.db",
            broker.url,
            f"http://127.0.0.1:{web}",
        ]
        arguments = [word for output in outputs for word in ("-o", output)]
        config = {"sensor": {"name": name}}
        self.daemon = Daemon(
            self.folder, "--port", port, *options, *arguments, config=config
        ).start()
        self._page = Page(web)
        self.n_messages = 0
        self.code: int | None = None

    def soak(self, seconds: float) -> None:
        """Count until it ends, or until it has run for so long."""
        wait_for(lambda: self.status_age() is not None or not self.daemon.is_alive, "a decision")
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and self.daemon.is_alive:
            try:
                self.samples.append(sample(self.daemon.pid))
            except (OSError, KeyError):
                break
            time.sleep(_EVERY_S)
        self.n_messages = self._page.n_messages
        self._page.close()
        self.code = self.daemon.stop()

    def status_age(self) -> float | None:
        """Return the age of the last decision, None before the first one."""
        status = self.daemon.status(self.name)
        return status.get("decision_age_s") if status.get("seq") else None

    def lines(self) -> list[str]:
        """Return what it said."""
        return (self.folder / "out.jsonl").read_text().splitlines()

    def found(self, stream_h: float | None) -> dict[str, Any]:
        """Return the keys of this run."""
        rows = self.samples
        settled = rows[len(rows) // 3 :]
        hours = np.array([(row.time_s - rows[0].time_s) / 3600 for row in settled])
        if stream_h is not None:
            hours *= stream_h / max(1e-9, (rows[-1].time_s - rows[0].time_s) / 3600)
        rss = np.array([row.rss_kib for row in settled], float)
        slope = float(np.polyfit(hours, rss, 1)[0]) if len(rows) > 5 else 0.0
        quarter = max(1, len(rows) // 4)
        early, late = rows[quarter : 2 * quarter] or rows, rows[-quarter:]
        return {
            "hours": round((rows[-1].time_s - rows[0].time_s) / 3600, 3),
            "rss_mib_first_last": [round(rss[0] / 1024, 1), round(rss[-1] / 1024, 1)],
            "rss_growth_kib_per_h": round(slope, 1),
            "fd_growth": median(r.n_fds for r in late) - median(r.n_fds for r in early),
            "thread_growth": median(r.n_threads for r in late)
            - median(r.n_threads for r in early),
            "messages_to_page": self.n_messages,
            "exit_code": self.code,
        }


def drift_ppm(lines: list[str]) -> float:
    """Return how much faster the stream's clock runs than that on the wall, in 1e-6.

    By the least delayed decisions of each tenth of the run: what comes late says nothing.
    """
    rows = [json.loads(line) for line in lines if '"decision"' in line]
    at = [
        (row["t_s"], datetime.fromisoformat(row["time"]).timestamp() - row["t_s"])
        for row in rows
        if row.get("type") == "decision"
    ]
    n = max(1, len(at) // 10)
    firsts = [min(at[k : k + n], key=lambda pair: pair[1]) for k in range(0, len(at) - n + 1, n)]
    if len(firsts) < 2:
        return 0.0
    slope = np.polyfit([t_s for t_s, _ in firsts], [lag_s for _, lag_s in firsts], 1)[0]
    return round(-1e6 * float(slope), 2)


def differing(live: list[dict[str, Any]], replayed: list[dict[str, Any]]) -> int:
    """Return how many decisions are not the same; live ones at the very end may be missing."""
    n = min(len(live), len(replayed))
    return sum(a != b for a, b in zip(live, replayed, strict=False)) + max(
        0, len(live) - 2 - n, len(replayed) - 2 - n
    )


def replay(soaked: Soaked) -> list[dict[str, Any]]:
    """Return the decisions on the recording of a run."""
    out = soaked.folder / "replay.jsonl"
    arguments = ["--port", f"replay:{soaked.folder / 'rec.h5'}", "--speed", "max"]
    daemon = Daemon(soaked.folder / "replay", *arguments, "-o", f"json:{out}").start()
    assert daemon.process is not None
    daemon.process.wait(_LAST_ENDS_S)
    return decisions(out.read_text().splitlines())


def main() -> int:
    """Soak, and print what grew."""
    about = (__doc__ or "").split("\n\n")
    parser = argparse.ArgumentParser(description=about[0], epilog=about[1])
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--stream-hours", type=float, default=24.0)
    parser.add_argument("--most-minutes", type=float, default=120.0, help="for the stream hours")
    parser.add_argument("--folder", type=Path, help="keep what was written there")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = (args.folder or Path(made)).resolve()
        folder.mkdir(exist_ok=True)
        with Broker(folder) as broker:
            found = soak(
                folder, broker, args.minutes * 60, args.stream_hours, args.most_minutes * 60
            )
    print(json.dumps(found))
    return 0


def soak(
    folder: Path, broker: Broker, seconds: float, stream_h: float, most_s: float
) -> dict[str, Any]:
    """Run the three daemons and return what the last line says."""
    made = []
    for rate_hz, share in ((60, 1.0), (200, 0.5)):
        name = f"hz{rate_hz}"
        port = f"sim:demo?rate={rate_hz}&run=soak"
        record = str(folder / name / "rec.h5")
        made.append((Soaked(name, folder, broker, port, "--record", record), seconds * share))
    duration = str(round(stream_h * 3600))
    fast = Soaked(
        "fast", folder, broker, "sim:demo?run=soak", "--speed", "max", "--duration", duration
    )
    threads = [threading.Thread(target=each.soak, args=(for_s,)) for each, for_s in made]
    threads.append(threading.Thread(target=fast.soak, args=(most_s,)))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = {each.name: each.found(None) for each, _ in made}
    for each, _ in made:
        lines = each.lines()
        found[each.name]["clock_drift_ppm"] = drift_ppm(lines)
        live, replayed = decisions(lines), replay(each)
        found[each.name]["decisions"] = len(live)
        found[each.name]["decisions_differ"] = differing(live, replayed)
    said = decisions(fast.lines())
    found["fast"] = fast.found(said[-1]["t_s"] / 3600) | {"decisions": len(said)}
    worst = {
        key: max((row[key] for row in found.values() if key in row), key=abs)
        for key in ("rss_growth_kib_per_h", "fd_growth", "thread_growth", "clock_drift_ppm")
    }
    differ = sum(row.get("decisions_differ", 0) for row in found.values())
    return {**worst, "decisions_differ": differ, "runs": found}


if __name__ == "__main__":
    sys.exit(main())
