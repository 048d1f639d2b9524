"""Runs in real time: a faulty line between a module on a pseudo-terminal and a radar.

The module's frames come 20 times a second, so that many runs at once do not starve each other;
the gate alone judges them.
"""

import random
import tempfile
import threading
import time
import traceback
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from campaigns.fault_run import Run
from campaigns.fault_world import Module
from campaigns.injector import Injector, drawn
from radard.stream.coalesced_reads import coalesced
from x2radar.device.transport import PtyTransport, SerialTransport
from x2radar.sim.module.faults import FaultPlan
from x2radar.sim.module.host import serve

_RATE_HZ = 20.0
_FAULTY_S = (4.0, 8.0)
_MAX_AFTER_S = 60.0
"""For a decision after the last fault, by the clock; a busy machine takes long."""
_OUTAGE_LIMIT_S = 30.0
"""As `fault_run.OUTAGE_S`, where the machine is busy with other runs."""
_STUCK_S = 60.0
_CLOCK = SimpleNamespace(now=time.monotonic, sleep=time.sleep)


def injected_run(n: int, seed: int) -> dict[str, Any]:
    """Run a radar behind a faulty line, whose module is well; return what was found."""
    rng = random.Random(f"{seed} {n}")  # noqa: S311 - no secret
    plan, own_seed, halt = drawn(rng), seed * 1000 + n, threading.Event()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        pty = PtyTransport()
        stack.callback(pty.close)
        module = Module(FaultPlan(), own_seed, 0.0)
        serving = _thread(lambda: serve(module, pty, stop=halt.is_set))
        stack.callback(serving.join, _STUCK_S)
        stack.callback(halt.set)
        injector = Injector(pty.path, folder / "module", plan, own_seed)
        stack.callback(injector.close)
        found = _watched(str(folder / "module"), n, injector)
    return {"what": str(plan), "injected": injector.n_faults, **found}


def _thread(target: Any) -> threading.Thread:
    thread = threading.Thread(target=target, daemon=True)
    thread.start()
    return thread


def _watched(path: str, n: int, injector: Injector) -> dict[str, Any]:
    run = Run(coalesced(lambda: SerialTransport(path)), _CLOCK, seed=n, rate_hz=_RATE_HZ)
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
        thread.join(_STUCK_S)
    if any(thread.is_alive() for thread in threads):
        found["deadlock"] = "a thread does not end"
    return {**found, "recovery": watcher.recovery(healed_s, _OUTAGE_LIMIT_S)}
