"""Faults of module, line, host and surroundings, and what a daemon makes of them.

    python campaigns/faults.py --runs 2000 --injected 200 --surroundings all
    python campaigns/faults.py --runs 40 --injected 2 --surroundings two_daemons   # short

--runs are seeded runs of the driver, the ring and the worker on a virtual clock, before a
simulated module with every fault that it has, alone and mixed, at rates up to one in ten, with
cables pulled and a host that stands still. --injected runs are in real time, on a pseudo-terminal
with a faulty line that shares no code with the simulator (`FaultyLine`).
--surroundings names cases of `surroundings`, with commas. Frames carry the time at which they
were made, which is the truth that decisions are held against.

The last line is one JSON object: runs; by kind of run what was counted; and the harm, which gives
exit code 1. hidden_restarts are those of a module's counter among lost frames, where its numbers
seem to go on: no driver can tell.
"""

import contextlib
import logging
import os
import random
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import lru_cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
# Before numpy is there: threads of its algebra wait in loops, for cores that other runs need.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

from campaigns.fault_run import Run
from campaigns.fault_world import Module, Over, World, clock_of, drawn_plan
from campaigns.processes import HARM, end_with, parser_of
from campaigns.surroundings import CASES, surrounded
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.stream.source import CoalescedReads
from tests.device_helpers import in_thread
from tests.waiting import wait_for
from x2radar.device.transport import PtyTransport, SerialTransport
from x2radar.sim.module.host import serve

_STUCK_S = 300  # of real time, for a run that takes a second where nothing else runs
_AFTER_S = 13.0  # from the last fault to the end of a run: `fault_run.OUTAGE_S` and two dwells
_MODEL = "fast"
_RATE_HZ = 20.0  # of injected runs, so that many at once do not starve each other
_FAULTY_S = (4.0, 8.0)
_MAX_AFTER_S = 60.0  # for a decision after the last fault, by the clock; a busy machine takes long
_OUTAGE_LIMIT_S = 30.0  # as `fault_run.OUTAGE_S`, where the machine is busy with other runs
_JOIN_S = 60.0
_CLOCK = SimpleNamespace(now=time.monotonic, sleep=time.sleep)
_WAIT_S = 0.02
_MAX_HELD = 1 << 18  # bytes that a stalled line holds back; more are lost, as in a real one


class Stuck(BaseException):
    """A run does not end."""


@lru_cache(maxsize=1)
def _classifier() -> Classifier:
    return Classifier(load_bundle(_MODEL))


def virtual_run(n: int, seed: int) -> dict[str, Any]:
    """Run a radar on a virtual clock; return what was found."""
    rng = random.Random(f"{seed} {n}")  # noqa: S311 - no secret
    plan = drawn_plan(n, seed)
    healed_s = rng.uniform(6.0, 16.0)
    ends = {"healed_s": healed_s, "end_s": healed_s + _AFTER_S}
    world = World(plan, seed * 1_000_000 + n, **ends, is_usb=rng.random() < 0.5)
    if rng.random() < 0.2:
        world.pause = rng.uniform(3.0, healed_s), rng.uniform(0.05, 4.0)
    found: dict[str, Any] = {"what": ",".join(f"{k}:{value:.3g}" for k, value in plan.items())}
    with clock_of(world):
        connect = world.connect
        if world.most_read:
            # With pauses between reads, which a line in pieces would make endless.
            times = {"clock": world.now, "sleep": world.sleep}
            connect = lambda: CoalescedReads(world.connect(), **times)  # noqa: E731
        run = Run(connect, world, seed=n, classifier=_classifier())
        world.tick = run.tick
        if "spike" in plan:
            world.on_healed = run.watcher.note_end_of_faults
        found |= _ended(run)
    return {**found, "run": run, "recovery": run.watcher.recovery(healed_s)}


def _ended(run: Run) -> dict[str, str]:
    """Run until the world ends; return what should not have been."""

    def stuck(*_: object) -> None:
        raise Stuck

    signal.signal(signal.SIGALRM, stuck)
    signal.alarm(_STUCK_S)
    try:
        run.go()
    except Over:
        return {}
    except Stuck:
        return {"deadlock": traceback.format_exc()}
    except Exception:  # noqa: BLE001 - counted
        return {"crash": traceback.format_exc()}
    finally:
        signal.alarm(0)
    return {"crash": "the stream ended"}


def drawn_line(rng: random.Random) -> dict[str, float]:
    """Return how bad a line is: one to four kinds, one in a thousand to one in ten chunks each.

    A stretch of a chunk is missing (drop), some of its bits are inverted (flip), it comes twice
    (double), bytes that nobody sent come before it (invent), nothing comes (stall) or the cable is
    pulled for up to `longest_s`; the host's commands may suffer, too (`both_ways`).
    """
    names = rng.sample(("drop", "flip", "double", "invent", "stall", "pull"), rng.randint(1, 4))
    plan = {name: 10 ** rng.uniform(-3, -1) for name in names}
    for name in plan.keys() & {"stall", "pull"}:
        # Each costs seconds, so few of them are already a bad line.
        plan[name] = min(plan[name], 0.02)
    return plan | {"longest_s": rng.uniform(0.2, 4.0), "both_ways": rng.random() < 0.5}


class FaultyLine(PtyTransport):
    """A terminal under `link` that a module is served on, with all that is wrong with its cable.

    While it `is_faulty` it drops, flips, doubles, invents and holds back stretches of bytes, and
    pulls the cable: the host's terminal goes away, and another one, of another name, comes back
    under the link.
    """

    def __init__(self, link: Path, plan: Mapping[str, float], rng: random.Random) -> None:
        self.n_faults, self.is_faulty = 0, True
        self.link, self._plan, self._rng = link, plan, rng
        self._until_s = self._plug_s = 0.0
        self._held = b""
        self._plug()

    def read(self, timeout_s: float) -> bytes:
        """Return what the host has sent, as a `Transport`; nothing while the cable is out."""
        self.write(b"")
        if self._master.closed:
            time.sleep(_WAIT_S)
            return b""
        data = super().read(min(timeout_s, _WAIT_S))
        return self._spoiled(data) if self._plan["both_ways"] else data

    def write(self, data: bytes) -> None:
        """Send the host what the line leaves of it, and what was held back before."""
        now_s = time.monotonic()
        if self._master.closed and (now_s >= self._plug_s or not self.is_faulty):
            self._plug()
        if len(self._held) < _MAX_HELD:
            self._held += self._spoiled(data)
        if self._master.closed:
            self._held = b""
        elif now_s >= self._until_s or not self.is_faulty:
            self._held = self._held[self._master.write(self._held) or 0 :]

    def close(self) -> None:
        """Pull the cable."""
        self.link.unlink(missing_ok=True)
        super().close()

    def _plug(self) -> None:
        super().__init__()
        fresh = self.link.with_suffix(".new")
        fresh.symlink_to(self.path)
        fresh.rename(self.link)

    def _falls(self, kind: str) -> bool:
        has_fallen = self._rng.random() < self._plan.get(kind, 0.0)
        self.n_faults += has_fallen
        return has_fallen

    def _spoiled(self, data: bytes) -> bytes:
        rng, longest_s = self._rng, self._plan["longest_s"]
        if not self.is_faulty or not data:
            return data
        if self._falls("drop"):
            at = rng.randrange(len(data))
            data = data[:at] + data[at + rng.randint(1, len(data)) :]
        if self._falls("flip") and data:
            spoiled = bytearray(data)
            for _ in range(rng.randint(1, 8)):
                spoiled[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            data = bytes(spoiled)
        if self._falls("double"):
            data += data
        if self._falls("invent"):
            data = rng.randbytes(rng.randint(1, 300)) + data
        if self._falls("stall"):
            self._until_s = time.monotonic() + rng.uniform(0.05, longest_s)
        if self._falls("pull") and not self._master.closed:
            self.close()
            self._plug_s = time.monotonic() + rng.uniform(0.05, longest_s)
        return data


def injected_run(n: int, seed: int) -> dict[str, Any]:
    """Run a radar behind a faulty line, whose module is well; return what was found."""
    rng = random.Random(f"{seed} {n}")  # noqa: S311 - no secret
    plan, halt = drawn_line(rng), threading.Event()
    with tempfile.TemporaryDirectory() as folder:
        line = FaultyLine(Path(folder) / "module", plan, rng)
        connect = lambda: CoalescedReads(SerialTransport(str(line.link)))  # noqa: E731
        run = Run(connect, _CLOCK, seed=n, rate_hz=_RATE_HZ)
        found: dict[str, Any] = {"what": str(plan), "run": run}

        def read() -> None:
            try:
                run.go()
            except Exception:  # noqa: BLE001 - counted
                found["crash"] = traceback.format_exc()

        def tick() -> None:
            while not halt.wait(0.5):
                run.tick()

        module = Module({}, seed * 1000 + n, 0.0)
        threads = [in_thread(read), in_thread(tick)]
        threads.append(in_thread(serve, module, line, stop=halt.is_set))
        time.sleep(random.Random(n).uniform(*_FAULTY_S))  # noqa: S311 - no secret
        line.is_faulty = False
        healed_s, watcher = time.monotonic(), run.watcher
        watcher.note_end_of_faults()

        def is_over() -> bool:
            bad_s = watcher.last_bad[0] if watcher.last_bad else healed_s
            is_well = any(now_s > bad_s + 1.0 for now_s, _ in watcher.wholes[-1:])
            return is_well or not threads[0].is_alive()

        with contextlib.suppress(AssertionError):
            wait_for(is_over, _MAX_AFTER_S)
        run.radar.close()
        halt.set()
        for thread in threads:
            thread.join(_JOIN_S)
        if any(thread.is_alive() for thread in threads):
            found["deadlock"] = "a thread does not end"
        line.close()
    recovery = watcher.recovery(healed_s, _OUTAGE_LIMIT_S)
    return {**found, "injected": line.n_faults, "recovery": recovery}


Judged = tuple[Counter[str], float, float]


def judge(run: Callable[[int, int], dict[str, Any]], seed: int, n: int) -> Judged:
    """Make run `n`, and say on stderr what should not have been; return counts and recovery."""
    found = run(n, seed)
    watcher, (stream_s, outage_s, fault) = found["run"].watcher, found["recovery"]
    counts = watcher.tally + Counter(
        runs=1,
        crashes="crash" in found,
        deadlocks="deadlock" in found,
        unrecovered=bool(fault),
        # What frames say and what the statistics say must be the same.
        uncounted=abs(found["run"].radar.stats.lost - watcher.tally["lost"]),
        injected=found.get("injected", 0),
    )
    if any(counts[key] for key in HARM):
        notes = filter(None, [*watcher.notes, fault, found.get("crash"), found.get("deadlock")])
        print(f"{run.__name__} {n} ({found['what']}): {list(notes)}", file=sys.stderr)
    return (counts, 0.0, 0.0) if fault else (counts, stream_s, outage_s)


def counted(results: Iterable[Judged]) -> dict[str, float]:
    """Return what runs of one kind have counted, and the longest that one took to come back."""
    total, stream_s, outage_s = Counter[str](), 0.0, 0.0
    for counts, *took_s in results:
        total.update(counts)
        stream_s, outage_s = map(max, (stream_s, outage_s), took_s)
    return {**total, "recovery_s_max": round(stream_s, 2), "outage_s_max": round(outage_s, 2)}


def main() -> int:
    """Run the campaign."""
    parser = parser_of(__doc__)
    parser.add_argument("--runs", type=int, default=2000, help="on the virtual clock")
    parser.add_argument("--injected", type=int, default=200, help="in real time, through a line")
    parser.add_argument("--surroundings", default="all", help="all, none, or " + ", ".join(CASES))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1, help="processes of virtual runs")
    parser.add_argument("--at-once", type=int, default=6, help="runs in real time side by side")
    parser.add_argument("--full", action="store_true", help="surroundings last as long as asked")
    args = parser.parse_args()
    # Radars tell of every loss, as they should.
    logging.disable(logging.WARNING)
    asked = {"all": ",".join(CASES), "none": ""}.get(args.surroundings, args.surroundings)
    with ProcessPoolExecutor(args.jobs) as pool:
        runs = pool.map(partial(judge, virtual_run, args.seed), range(args.runs), chunksize=4)
        kinds = {"virtual": counted(runs)}
    with ThreadPoolExecutor(args.at_once) as pool:
        runs = pool.map(partial(judge, injected_run, args.seed), range(args.injected))
        kinds["injected"] = counted(runs)
    cases = surrounded(filter(None, asked.split(",")), is_full=args.full)
    rows = [*kinds.values(), *cases.values()]
    sums = {
        key: sum(row.get(key, 0) for row in rows) for key in (*HARM, "runs", "hidden_restarts")
    }
    summary = {**sums, "kinds": kinds, "surroundings": cases}
    return end_with(summary | {"runs": sums["runs"] + len(cases)})


if __name__ == "__main__":
    sys.exit(main())
