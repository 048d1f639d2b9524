"""Runs in real time: a module on a pseudo-terminal, and a faulty line between two of them.

The module's frames come 20 times a second, so that many runs at once do not starve each other;
the gate alone judges them.
"""

import random
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from campaigns.fault_run import Run
from campaigns.fault_world import Module, drawn_plan
from campaigns.injector import Injector, drawn
from radard.stream.coalesced_reads import coalesced
from x2radar.device.transport import PtyTransport, SerialTransport
from x2radar.sim.module.faults import KINDS, FaultPlan
from x2radar.sim.module.host import serve

_RATE_HZ = 20
_FAULTY_S = (4.0, 8.0)
_MOST_AFTER_S = 60.0
"""For a decision after the last fault, by the clock; a busy machine takes long."""
_OUTAGE_LIMIT_S = 30.0
"""As `fault_run.OUTAGE_S`, where the machine is busy with other runs."""
_STUCK_S = 60.0
_SERVED = [name for name in KINDS if name not in {"hang_up", "safe_mode", "silent"}]
"""A module that hangs up is not put in again by anybody here; the virtual runs have that."""


class _RealClock:
    """The host's."""

    now = staticmethod(time.monotonic)
    sleep = staticmethod(time.sleep)


class _Served:
    """A module on the master side of a terminal, in a thread."""

    def __init__(self, plan: FaultPlan, seed: int) -> None:
        self.module = Module(plan, seed, 0.0)
        self.pty = PtyTransport()
        self._must_heal, self._halt = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def heal(self) -> None:
        """End its faults."""
        self._must_heal.set()

    def close(self) -> None:
        """End it."""
        self._halt.set()
        self._thread.join(_STUCK_S)
        self.pty.close()

    def _run(self) -> None:
        serve(self.module, self.pty, stop=self._is_over)

    def _is_over(self) -> bool:
        # In the module's own thread, between two of its steps.
        if self._must_heal.is_set():
            self._must_heal.clear()
            self.module.heal()
        return self._halt.is_set()


def pty_run(n: int, seed: int) -> dict[str, Any]:
    """Run a radar on a terminal, whose module has faults of its own."""
    plan = drawn_plan(n, seed, names=_SERVED)
    served = _Served(plan, seed * 1000 + n)
    what = ",".join(f"{kind}:{value:.3g}" for kind, value in plan.values.items())
    with ExitStack() as stack:
        stack.callback(served.close)
        return {"n": n, "what": f"pty {what}", **_watched(served.pty.path, n, served.heal)}


def injected_run(n: int, seed: int) -> dict[str, Any]:
    """Run a radar behind a faulty line, whose module is well."""
    rng = random.Random(f"{seed} {n}")  # noqa: S311 - no secret
    plan = drawn(rng)
    served = _Served(FaultPlan(), seed * 1000 + n)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.callback(served.close)
        injector = Injector(served.pty.path, folder / "module", plan, seed * 1000 + n)
        stack.callback(injector.close)
        found = _watched(str(folder / "module"), n, injector.heal)
        return {"n": n, "what": f"injected {plan}", "injected": injector.n_faults, **found}


def _watched(path: str, n: int, heal: Callable[[], object]) -> dict[str, Any]:
    run = Run(
        coalesced(lambda: SerialTransport(path)), _RealClock(), seed=n, rate_hz=float(_RATE_HZ)
    )
    found: dict[str, Any] = {}
    halt = threading.Event()

    def read() -> None:
        try:
            run.go()
        except Exception:  # noqa: BLE001 - counted
            found["crash"] = traceback.format_exc()

    def tick() -> None:
        while not halt.wait(0.5):
            run.tick()

    threads = [threading.Thread(target=target, daemon=True) for target in (read, tick)]
    for thread in threads:
        thread.start()
    time.sleep(random.Random(n).uniform(*_FAULTY_S))  # noqa: S311 - no secret
    heal()
    healed_s = time.monotonic()
    run.watcher.note_end_of_faults()
    while time.monotonic() - healed_s < _MOST_AFTER_S and threads[0].is_alive():
        time.sleep(0.1)
        # Well again, and no bad frame for a while.
        bad_s = run.watcher.last_bad[0] if run.watcher.last_bad else healed_s
        if any(now_s > bad_s + 1.0 for now_s, _ in run.watcher.wholes[-1:]):
            break
    run.radar.close()
    halt.set()
    for thread in threads:
        thread.join(_STUCK_S)
    if any(thread.is_alive() for thread in threads):
        found["deadlock"] = "a thread does not end"
    recovery = run.watcher.recovery(healed_s, _OUTAGE_LIMIT_S)
    return {**found, "tally": run.watcher.tally, "recovery": recovery, "stats": run.radar.stats}
