"""Serve a simulated module on a transport: the loop that gives it a port and a clock."""

import contextlib
import math
import threading
import time
from collections.abc import Callable

from x2radar.device.transport import Transport, memory_pair
from x2radar.errors import TransportClosed
from x2radar.sim.module.module import SimulatedModule

_IDLE_S = 0.05  # longest wait before `stop` is asked again: nobody notices that it ends so late


def serve(
    module: SimulatedModule,
    transport: Transport,
    *,
    speed: float | None = 1.0,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Run `module` behind `transport`, as it is read and at `speed` at most, until it ends.

    In real time frames are skipped that were not read soon enough, as by a module's hardware.
    """
    started_s, now_s = time.monotonic(), 0.0

    def clock_s() -> float:
        return math.inf if speed is None else (time.monotonic() - started_s) * speed

    with contextlib.suppress(TransportClosed):
        while not stop():
            wait_s = _IDLE_S
            if (due_s := module.next_due_s) < math.inf:
                wait_s = min(max((due_s - clock_s()) / (speed or 1.0), 0.0), _IDLE_S)
            if data := transport.read(wait_s):
                module.receive(data)
            reached_s = clock_s() if speed == 1.0 else min(clock_s(), module.next_due_s)
            now_s = reached_s if reached_s < math.inf else now_s
            module.advance(now_s)
            while out := module.data_to_send():
                transport.write(out)
            if module.has_hung_up:
                transport.close()
                return


def connect(make: Callable[[], SimulatedModule], speed: float | None) -> Transport:
    """Return a transport to a new module that runs in a thread of this process, as `serve`."""
    module = make()
    near, far = memory_pair(keeps_pieces=module.splits_output)

    def run() -> None:
        try:
            serve(module, far, speed=speed)
        finally:
            # Whatever ended the module, its host must see a closed port, not a silent one.
            far.close()

    threading.Thread(target=run, name="sim-module", daemon=True).start()
    return near
