"""Faults of module, line, host and surroundings, and what a daemon makes of them.

    python campaigns/faults.py --runs 2000 --injected 200 --surroundings all
    python campaigns/faults.py --runs 40 --injected 2 --surroundings two_daemons   # short

--runs are seeded runs of the driver, the ring and the worker on a virtual clock, before a
simulated module with every fault that it has, alone and mixed, at rates up to one in ten, with
cables pulled and a host that stands still. --injected runs are in real time, through a faulty
line between two pseudo-terminals that shares no code with the simulator (`fault_lines`).
--surroundings names cases of `surroundings`, with commas. Frames carry
the time at which they were made, which is the truth that decisions are held against.

The last line is one JSON object: runs; crashes; deadlocks; gap_decisions (a window with a gap
or a jump that was judged as if whole); silent_stalls (nothing decided, nothing said);
unrecovered (no decision 3.1 s of stream after the last bad frame, or no good frame in time);
uncounted (frames that are missing and that nobody counted); lost_events (of the surroundings);
and, by kind of run, the same and more. hidden_restarts are those of a module's counter among lost
frames, where its numbers seem to go on: no driver can tell. Exit code 1 if harm was found.
"""

import logging
import os
import random
import signal
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
# Before numpy is there: threads of its algebra wait in loops, for cores that other runs need.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

from campaigns.fault_lines import injected_run
from campaigns.fault_run import Run
from campaigns.fault_world import Over, World, clock_of, drawn_plan
from campaigns.processes import HARM, end_with, parser_of
from campaigns.surroundings import CASES, surrounded
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.stream.coalesced_reads import CoalescedReads

_STUCK_S = 300
"""Of real time, for a run that takes a second where nothing else runs."""
_AFTER_S = 13.0
"""From the end of the faults to that of the run: `fault_run.OUTAGE_S` and two dwells."""
_MODEL = "fast"


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
