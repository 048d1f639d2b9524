"""Runs in real time: a faulty line between a module on a pseudo-terminal and a radar.

`Injector`, which shares no code with the driver or its simulator, opens the terminal that a
module's end serves, offers another one to a host under a fixed link, and passes bytes both ways.
While it is faulty it drops, flips, doubles, invents and holds back stretches of them, and pulls
the cable: the host's terminal goes away, and another one, of another name, comes back under the
link. The module's frames come 20 times a second, so that many runs at once do not starve each
other; the gate alone judges them.
"""

import contextlib
import os
import pty
import random
import select
import tempfile
import threading
import time
import traceback
import tty
from collections import deque
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from campaigns.fault_run import Run
from campaigns.fault_world import Module
from radard.stream.coalesced_reads import CoalescedReads
from x2radar.device.transport import PtyTransport, SerialTransport
from x2radar.sim.module.host import serve

_RATE_HZ = 20.0
_FAULTY_S = (4.0, 8.0)
_MAX_AFTER_S = 60.0
"""For a decision after the last fault, by the clock; a busy machine takes long."""
_OUTAGE_LIMIT_S = 30.0
"""As `fault_run.OUTAGE_S`, where the machine is busy with other runs."""
_STUCK_S = 60.0
_CLOCK = SimpleNamespace(now=time.monotonic, sleep=time.sleep)
_CHUNK = 4096
_WAIT_S = 0.02
_MAX_HELD = 1 << 18
"""Bytes that a stalled line holds back; more are lost, as in a real one."""


def drawn(rng: random.Random) -> dict[str, float]:
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
    """Pass bytes between the terminal at `module_path` and another one behind `link`."""

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
    plan, own_seed, halt = drawn(rng), seed * 1000 + n, threading.Event()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        served = PtyTransport()
        stack.callback(served.close)
        module = Module({}, own_seed, 0.0)
        serving = _thread(lambda: serve(module, served, stop=halt.is_set))
        stack.callback(serving.join, _STUCK_S)
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
        thread.join(_STUCK_S)
    if any(thread.is_alive() for thread in threads):
        found["deadlock"] = "a thread does not end"
    return {**found, "recovery": watcher.recovery(healed_s, _OUTAGE_LIMIT_S)}
