"""Faults of module, line, host and surroundings, and what a daemon makes of them.

    python campaigns/faults.py --runs 2000 --injected 200 --surroundings all
    python campaigns/faults.py --runs 40 --injected 2 --surroundings two_daemons   # short

--runs are seeded runs of the driver, the ring and the worker on a virtual clock, before a
simulated module with every fault that it has, alone and mixed, at rates up to one in ten, with
cables pulled and a host that stands still. --injected runs are in real time, through a faulty
line between two pseudo-terminals that shares no code with the simulator (`Injector`).
--surroundings names cases of `surroundings`, with commas. Frames carry
the time at which they were made, which is the truth that decisions are held against.

The last line is one JSON object: runs; crashes; deadlocks; gap_decisions (a window with a gap
or a jump that was judged as if whole); silent_stalls (nothing decided, nothing said);
unrecovered (no decision 3.1 s of stream after the last bad frame, or no good frame in time);
uncounted (frames that are missing and that nobody counted); lost_events (of the surroundings);
and, by kind of run, the same and more. hidden_restarts are those of a module's counter among lost
frames, where its numbers seem to go on: no driver can tell. Exit code 1 if harm was found.
"""

import contextlib
import logging
import os
import pty
import random
import select
import signal
import sys
import tempfile
import threading
import time
import traceback
import tty
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack
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
from x2radar.device.transport import PtyTransport, SerialTransport
from x2radar.sim.module.host import serve

_STUCK_S = 300
"""Of real time, for a run that takes a second where nothing else runs."""
_AFTER_S = 13.0
"""From the end of the faults to that of the run: `fault_run.OUTAGE_S` and two dwells."""
_MODEL = "fast"
_RATE_HZ = 20.0  # of injected runs, so that many at once do not starve each other
_FAULTY_S = (4.0, 8.0)
_MAX_AFTER_S = 60.0
"""For a decision after the last fault, by the clock; a busy machine takes long."""
_OUTAGE_LIMIT_S = 30.0
"""As `fault_run.OUTAGE_S`, where the machine is busy with other runs."""
_JOIN_S = 60.0
_CLOCK = SimpleNamespace(now=time.monotonic, sleep=time.sleep)
_CHUNK = 4096
_WAIT_S = 0.02
_MAX_HELD = 1 << 18
"""Bytes that a stalled line holds back; more are lost, as in a real one."""


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
        world.pauses.append((rng.uniform(3.0, healed_s), rng.uniform(0.05, 4.0)))
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


class Injector:
    """Pass bytes between the terminal at `module_path` and another one behind `link`.

    It opens the terminal that a module's end serves, offers another one to a host under a fixed
    link, and passes bytes both ways. While it is faulty it drops, flips, doubles, invents and
    holds back stretches of them, and pulls the cable: the host's terminal goes away, and another
    one, of another name, comes back under the link.
    """

    def __init__(self, module_path: str, link: Path, plan: Mapping[str, float], seed: int) -> None:
        self.n_faults = 0
        self._plan = plan
        self._rng = random.Random(seed)  # noqa: S311 - no secret
        self._link = link
        self._module = os.open(module_path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._module)
        self._host = -1
        self._until_s = self._plug_s = 0.0
        self._to_host: deque[bytes] = deque()
        self._to_module: deque[bytes] = deque()
        self._is_faulty = True
        self._halt = threading.Event()
        self._plug()
        self._thread = threading.Thread(target=self._run, name="injector", daemon=True)
        self._thread.start()

    def heal(self) -> None:
        """Let nothing go wrong from here on."""
        self._is_faulty = False

    def close(self) -> None:
        """End, and close both terminals."""
        self._halt.set()
        self._thread.join()
        self._unplug()
        os.close(self._module)

    def _plug(self) -> None:
        self._host, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self._host, False)
        # Kept open: a host that closes its end and opens it again finds the same terminal.
        self._slave = slave
        fresh = self._link.with_suffix(".new")
        fresh.symlink_to(os.ttyname(slave))
        fresh.rename(self._link)

    def _unplug(self) -> None:
        if self._host >= 0:
            self._link.unlink()
            os.close(self._host)
            os.close(self._slave)
            self._host = -1

    def _run(self) -> None:
        while not self._halt.is_set():
            now_s = time.monotonic()
            if self._host < 0 and (now_s >= self._plug_s or not self._is_faulty):
                self._to_host.clear()
                self._plug()
            is_stalled = self._is_faulty and now_s < self._until_s
            ends = [self._module] + ([self._host] if self._host >= 0 else [])
            ready, _, _ = select.select(ends, [], [], _WAIT_S)
            if self._module in ready:
                self._take(self._module, self._to_host, self._is_faulty)
            if self._host in ready:
                spoils = self._is_faulty and bool(self._plan["both_ways"])
                self._take(self._host, self._to_module, spoils)
            self._give(self._module, self._to_module)
            if self._host < 0:
                self._to_host.clear()
            elif not is_stalled:
                self._give(self._host, self._to_host)

    def _take(self, end: int, queue: deque[bytes], spoils: bool) -> None:
        data = b""
        with contextlib.suppress(OSError):
            data = os.read(end, _CHUNK)
        if not data:
            return
        if spoils:
            data = self._spoiled(data)
        if sum(map(len, queue)) < _MAX_HELD:
            queue.append(data)

    @staticmethod
    def _give(end: int, queue: deque[bytes]) -> None:
        with contextlib.suppress(OSError):
            while queue:
                queue[0] = queue[0][os.write(end, queue[0]) :]
                if queue[0]:
                    return
                queue.popleft()

    def _falls(self, kind: str) -> bool:
        has_fallen = self._rng.random() < self._plan.get(kind, 0.0)
        self.n_faults += has_fallen
        return has_fallen

    def _spoiled(self, data: bytes) -> bytes:
        rng, longest_s = self._rng, self._plan["longest_s"]
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
        if self._falls("pull") and self._host >= 0:
            self._unplug()
            self._plug_s = time.monotonic() + rng.uniform(0.05, longest_s)
        return data


def injected_run(n: int, seed: int) -> dict[str, Any]:
    """Run a radar behind a faulty line, whose module is well; return what was found."""
    rng = random.Random(f"{seed} {n}")  # noqa: S311 - no secret
    plan, own_seed, halt = drawn_line(rng), seed * 1000 + n, threading.Event()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        served = PtyTransport()
        stack.callback(served.close)
        module = Module({}, own_seed, 0.0)
        serving = _thread(lambda: serve(module, served, stop=halt.is_set))
        stack.callback(serving.join, _JOIN_S)
        stack.callback(halt.set)
        injector = Injector(served.path, folder / "module", plan, own_seed)
        stack.callback(injector.close)
        found = _watched(str(folder / "module"), n, injector)
    return {"what": str(plan), "injected": injector.n_faults, **found}


def _thread(target: Any) -> threading.Thread:
    thread = threading.Thread(target=target, daemon=True)
    thread.start()
    return thread


def _watched(path: str, n: int, injector: Injector) -> dict[str, Any]:
    run = Run(lambda: CoalescedReads(SerialTransport(path)), _CLOCK, seed=n, rate_hz=_RATE_HZ)
    watcher = run.watcher
    found: dict[str, Any] = {"run": run}
    halt = threading.Event()

    def read() -> None:
        try:
            run.go()
        except Exception:  # noqa: BLE001 - counted
            found["crash"] = traceback.format_exc()

    def tick() -> None:
        while not halt.wait(0.5):
            run.tick()

    threads = [_thread(read), _thread(tick)]
    time.sleep(random.Random(n).uniform(*_FAULTY_S))  # noqa: S311 - no secret
    injector.heal()
    healed_s = time.monotonic()
    watcher.note_end_of_faults()
    while time.monotonic() - healed_s < _MAX_AFTER_S and threads[0].is_alive():
        time.sleep(0.1)
        # Well again, and no bad frame for a while.
        bad_s = watcher.last_bad[0] if watcher.last_bad else healed_s
        if any(now_s > bad_s + 1.0 for now_s, _ in watcher.wholes[-1:]):
            break
    run.radar.close()
    halt.set()
    for thread in threads:
        thread.join(_JOIN_S)
    if any(thread.is_alive() for thread in threads):
        found["deadlock"] = "a thread does not end"
    return {**found, "recovery": watcher.recovery(healed_s, _OUTAGE_LIMIT_S)}


Judged = tuple[str, tuple[float, float, str], Counter[str], list[str]]


def judge(run: Callable[[int, int], dict[str, Any]], seed: int, n: int) -> Judged:
    """Make run `n`; return which it was, its counts, and what to say of it."""
    found = run(n, seed)
    watcher, (*_, fault) = found["run"].watcher, found["recovery"]
    counts = watcher.tally + Counter(
        runs=1,
        crashes="crash" in found,
        deadlocks="deadlock" in found,
        unrecovered=bool(fault),
        # What frames say and what the statistics say must be the same.
        uncounted=abs(found["run"].radar.stats.lost - watcher.tally["lost"]),
        injected=found.get("injected", 0),
    )
    notes = [*watcher.notes, fault, found.get("crash"), found.get("deadlock")]
    told = [note for note in notes if note and any(counts[key] for key in HARM)]
    return f"{n} ({found['what']})", found["recovery"], counts, told


def counted(kind: str, results: Iterable[Judged]) -> dict[str, float]:
    """Count runs of one kind, and say on stderr which were not as they should be."""
    total: Counter[str] = Counter()
    stream_s = outage_s = 0.0
    for which, (own_stream_s, own_outage_s, fault), counts, notes in results:
        total.update(counts)
        if not fault:
            stream_s, outage_s = max(stream_s, own_stream_s), max(outage_s, own_outage_s)
        if notes:
            print(f"{kind} {which}: {notes}", file=sys.stderr)
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
        kinds = {"virtual": counted("virtual", runs)}
    with ThreadPoolExecutor(args.at_once) as pool:
        runs = pool.map(partial(judge, injected_run, args.seed), range(args.injected))
        kinds["injected"] = counted("injected", runs)
    cases = surrounded(filter(None, asked.split(",")), is_full=args.full)
    rows = [*kinds.values(), *cases.values()]
    sums = {
        key: sum(row.get(key, 0) for row in rows) for key in (*HARM, "runs", "hidden_restarts")
    }
    summary = {**sums, "kinds": kinds, "surroundings": cases}
    return end_with(summary | {"runs": sums["runs"] + len(cases)})


if __name__ == "__main__":
    sys.exit(main())
