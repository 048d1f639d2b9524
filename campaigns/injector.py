"""A faulty line between two pseudo-terminals; shares no code with the driver or its simulator.

`Injector` opens the terminal that a module's end serves, offers another one to a host under a
fixed link, and passes bytes both ways. While it is faulty it drops, flips, doubles, invents and
holds back stretches of them, and pulls the cable: the host's terminal goes away, and another one,
of another name, comes back under the link.
"""

import contextlib
import os
import pty
import random
import select
import threading
import time
import tty
from collections import deque
from dataclasses import dataclass
from pathlib import Path

_CHUNK = 4096
_WAIT_S = 0.02
_MAX_HELD = 1 << 18
"""Bytes that a stalled line holds back; more are lost, as in a real one."""


@dataclass(frozen=True, slots=True)
class Plan:
    """How bad the line is: the shares are per chunk of up to 4096 bytes, at most one in ten."""

    drop: float = 0.0  # a stretch of the chunk is missing
    flip: float = 0.0  # some of its bits are inverted
    double: float = 0.0  # it comes twice
    invent: float = 0.0  # bytes that nobody sent come before it
    stall: float = 0.0  # nothing comes for up to `longest_s`
    pull: float = 0.0  # the cable is pulled, for up to `longest_s`
    longest_s: float = 2.0
    both_ways: bool = False  # whether the host's commands suffer, too


def drawn(rng: random.Random) -> Plan:
    """Return a plan of one to four kinds at rates from one in a thousand to one in ten."""
    names = rng.sample(("drop", "flip", "double", "invent", "stall", "pull"), rng.randint(1, 4))
    rates = {name: 10 ** rng.uniform(-3, -1) for name in names}
    for name in ("stall", "pull"):
        if name in rates:
            # Each costs seconds, so few of them are already a bad line.
            rates[name] = min(rates[name], 0.02)
    return Plan(**rates, longest_s=rng.uniform(0.2, 4.0), both_ways=rng.random() < 0.5)


class Injector:
    """Pass bytes between the terminal at `module_path` and another one behind `link`."""

    def __init__(self, module_path: str, link: Path, plan: Plan, seed: int) -> None:
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
                spoils = self._is_faulty and self._plan.both_ways
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
        while queue:
            try:
                n = os.write(end, queue[0])
            except OSError:
                return
            if n < len(queue[0]):
                queue[0] = queue[0][n:]
                return
            queue.popleft()

    def _falls(self, share: float) -> bool:
        has_fallen = self._rng.random() < share
        self.n_faults += has_fallen
        return has_fallen

    def _spoiled(self, data: bytes) -> bytes:
        rng, plan = self._rng, self._plan
        if self._falls(plan.drop):
            at = rng.randrange(len(data))
            data = data[:at] + data[at + rng.randint(1, len(data)) :]
        if self._falls(plan.flip) and data:
            spoiled = bytearray(data)
            for _ in range(rng.randint(1, 8)):
                spoiled[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            data = bytes(spoiled)
        if self._falls(plan.double):
            data += data
        if self._falls(plan.invent):
            data = rng.randbytes(rng.randint(1, 300)) + data
        if self._falls(plan.stall):
            self._until_s = time.monotonic() + rng.uniform(0.05, plan.longest_s)
        if self._falls(plan.pull) and self._host >= 0:
            self._unplug()
            self._plug_s = time.monotonic() + rng.uniform(0.05, plan.longest_s)
        return data
