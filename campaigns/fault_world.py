"""A world with a clock of its own: a simulated module, its cable, and the host's time.

Nothing here waits: to read a port moves the clock to what comes next. Until `healed_s` the module
and its line have faults, the cable is pulled and put in again, and the host stands still at
times; from then on nothing goes wrong any more.
"""

import math
import random
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from itertools import cycle
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np

from campaigns.fault_run import StampingFirmware
from x2radar.device.transport import Transport
from x2radar.errors import PortNotFound, TransportClosed
from x2radar.modules.base import ModuleSettings
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module.faults import KINDS, FaultPlan, Faults
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import load_scene

_MAX_RATE = 0.1  # one in ten
_KERNEL_BYTES = 1 << 16
_TERMINAL_BYTES = 4095  # a Linux terminal gives no more to one read
_TICK_S = 0.5
_READ_COST_S = 2e-5  # of a read that finds nothing: a loop without a pause would stop the clock
_KEPT_FRAMES = 1800  # of the scene's echoes, which are then repeated
SCENE = "human"


class Over(BaseException):
    """The run's time is over."""


@lru_cache(maxsize=1)
def _echoes() -> list[Any]:
    """Return the echoes of a scene; for any rate, since nobody looks at speeds."""
    stream = EchoStream(load_scene(SCENE), 0, RadarSettings.for_frame_rate(60))
    return [stream.next() for _ in range(_KEPT_FRAMES)]


class Module(SimulatedModule):
    """A simulated module whose faults can end, with frames that say when they were made."""

    def __init__(self, plan: FaultPlan, seed: int, born_s: float) -> None:
        self.born_s = born_s
        self.has_booted = False  # since its cable was looked at
        firmware = StampingFirmware()
        firmware.now_s = lambda: self.born_s + self._now_s
        super().__init__(load_scene(SCENE), seed, plan, firmware=firmware)

    def heal(self) -> None:
        """Let nothing go wrong from here on; what was held back comes now."""
        queue = self._faults._queue
        self._faults = Faults({}, 0)
        for _, piece in queue:
            self._faults.put(piece, self._now_s)
        self._commands = deque((self._now_s, command) for _, command in self._commands)
        if self._ready_due_s < float("inf"):
            self._ready_due_s = self._now_s

    def _start(self, settings: ModuleSettings) -> None:
        made = {"settings": settings, "axis": settings.axis, "next": cycle(_echoes()).__next__}
        self._stream, self._resume = SimpleNamespace(**made), None  # type: ignore[assignment]
        self._counter, self._frame_due_s = 0, self._now_s

    def _restart(self) -> None:
        super()._restart()
        self.has_booted = True


class World:
    """One module on one cable, from the start to `end_s`, when `Over` is raised."""

    def __init__(
        self, plan: FaultPlan, seed: int, *, healed_s: float, end_s: float, is_usb: bool = False
    ) -> None:
        self._rng = random.Random(seed)  # noqa: S311 - no secret
        self._plan, self._seed, self.is_usb = plan, seed, is_usb
        self._healed_s, self._end_s = healed_s, end_s
        self._now_s, self._tick_s = 1.0, 1.0
        self.module = Module(plan, seed, self._now_s)
        # Bytes of a read; 0 for one piece of what the line made.
        self.most_read = self._rng.choice((0, _TERMINAL_BYTES, _KERNEL_BYTES))
        self._port: Port | None = None
        self._plugged_s = 0.0
        self.tick: Callable[[], object] = lambda: None  # called twice a second
        self.on_healed: Callable[[], object] = lambda: None
        self.pause: tuple[float, float] | None = None  # when the host stands still, and how long

    def now(self) -> float:
        """Return the time, in seconds."""
        return self._now_s

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        until_s = self._now_s + seconds
        while self._now_s < until_s:
            self.step(until_s)

    def connect(self) -> Transport:
        """Open the port; raises PortNotFound while the cable is out."""
        if self._now_s < self._plugged_s:
            # To look for a port takes no time here, so some passes at least.
            self.sleep(0.001)
            msg = "module: no such port"
            raise PortNotFound(msg)
        self._port = Port(self)
        return self._port

    def step(self, until_s: float) -> None:
        """Go on to what happens next, at `until_s` at the latest."""
        module = self.module
        wake_s = min(self._tick_s + _TICK_S, max(self._healed_s, self._now_s))
        next_s = module.next_due_s
        due_s = max(module.born_s + next_s, self._now_s)
        self._now_s = min(due_s, wake_s, until_s)
        if self._now_s >= self._end_s:
            raise Over
        if self._now_s >= self._healed_s:
            self._healed_s, self._plan = math.inf, {}
            module.heal()
            # Somebody puts the cable in again.
            self._plugged_s = min(self._plugged_s, self._now_s)
            self.on_healed()
        # Sums of floats: what is due now must not be due a moment later for ever.
        own_s = self._now_s - module.born_s
        module.advance(max(own_s, next_s) if self._now_s == due_s else own_s)
        while out := module.data_to_send():
            if self._port is not None:
                self._port.arrive(out)
        self._look_at_cable()
        if self._now_s >= self._tick_s + _TICK_S:
            self._tick_s = self._now_s
            self.tick()

    def _look_at_cable(self) -> None:
        module = self.module
        if module.has_hung_up:
            self._pull(self._rng.uniform(0.1, 5.0))
            self._seed += 1_000_003
            self.module = Module(self._plan, self._seed, self._now_s)
        elif module.has_booted:
            module.has_booted = False
            if self.is_usb:
                self._pull(0.04)

    def _pull(self, for_s: float) -> None:
        if self._port is not None:
            self._port.is_gone = True
            self._port = None
        self._plugged_s = self._now_s + for_s


class Port:
    """The host's end of the cable, as `Transport` has it."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._waiting: deque[bytes] = deque()
        self.is_usb = world.is_usb
        self.is_gone = False

    def arrive(self, data: bytes) -> None:
        """Take bytes from the cable; those that no buffer holds are lost."""
        if taken := data[: _KERNEL_BYTES - sum(map(len, self._waiting))]:
            self._waiting.append(taken)

    def read(self, timeout_s: float) -> bytes:
        """Return a piece, as the module gave it or as a kernel does."""
        world = self._world
        if world.pause is not None and world.now() >= world.pause[0]:
            # What does not fit into buffers is lost.
            (_, pause_s), world.pause = world.pause, None
            world.sleep(pause_s)
        until_s = world.now() + max(timeout_s, _READ_COST_S)
        while not self._waiting and world.now() < until_s and not self.is_gone:
            world.step(until_s)
        if not self._waiting:
            self._check()
            return b""
        if n := world.most_read:
            # A kernel hands out what there is, whatever pieces it came in.
            joined = b"".join(self._waiting)
            self._waiting = deque(filter(None, (joined[:n], joined[n:])))
        return self._waiting.popleft()

    def write(self, data: bytes) -> None:
        """Hand the module what the host sends."""
        self._check()
        self._world.module.receive(data)

    def close(self) -> None:
        """Close it; nothing is read from it any more."""
        self.is_gone = True
        self._waiting.clear()

    def _check(self) -> None:
        if self.is_gone:
            msg = "module: the port is gone"
            raise TransportClosed(msg)


@contextmanager
def clock_of(world: World) -> Iterator[None]:
    """Let this process have its time from a world for a while."""

    def wait(event: threading.Event, timeout: float | None = None) -> bool:
        world.sleep(timeout or 0.0)
        return event.is_set()

    with patch("time.monotonic", world.now), patch.object(threading.Event, "wait", wait):
        yield


_SECONDS = {"silent": 15.0, "hang_up": 15.0, "slow_ack": 3.0, "not_ready": 12.0, "merge": 4.0}
"""Highest values: longer than the faults last would say nothing new."""


def drawn_plan(n: int, seed: int) -> FaultPlan:
    """Return the faults of run `n`: first each kind alone, at its highest rate, then mixtures."""
    rng = np.random.default_rng([seed, n])
    names = list(KINDS)
    is_alone = n < len(names)
    drawn = [names[n]] if is_alone else list(rng.choice(names, rng.integers(1, 5), False))
    return {str(name): _value(str(name), rng, is_top=is_alone) for name in drawn}


def _value(name: str, rng: np.random.Generator, *, is_top: bool) -> float:
    kind = KINDS[name]
    if kind.unit.startswith("per "):
        return _MAX_RATE if is_top else float(10 ** rng.uniform(-4, -1))
    if kind.is_whole:
        return float(rng.integers(1, 2000))
    most = min(kind.most, _SECONDS.get(name, kind.most))
    if is_top and name not in {"silent", "hang_up"}:
        return most
    return float(rng.uniform(kind.least, most))
