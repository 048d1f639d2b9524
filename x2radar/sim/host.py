"""Serve a simulated module on a transport: the loop that gives it a port and a clock."""

import contextlib
import threading
import time
from collections.abc import Callable

from x2radar.errors import TransportClosed
from x2radar.sim.module import SimulatedModule
from x2radar.transport import MemoryTransport, Transport, memory_pair

_IDLE_S = 0.05


def serve(
    module: SimulatedModule,
    transport: Transport,
    *,
    speed: float | None = 1.0,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Run `module` behind `transport` until the transport closes or `stop` says so.

    Parameters
    ----------
    module : SimulatedModule
        What answers.
    transport : Transport
        Where its bytes come and go.
    speed : float or None
        Module seconds per real second; None is as fast as the host reads.
    stop : callable
        Asked before every wait.
    """
    started_s = time.monotonic()
    now_s = 0.0
    with contextlib.suppress(TransportClosed):
        while not stop():
            due_s = module.next_due_s
            if speed is None:
                wait_s = 0.0 if due_s < float("inf") else _IDLE_S
            else:
                now_s = (time.monotonic() - started_s) * speed
                wait_s = min(max((due_s - now_s) / speed, 0.0), _IDLE_S)
            if data := transport.read(wait_s):
                module.receive(data)
            if speed is None:
                due_s = module.next_due_s
                now_s = due_s if due_s < float("inf") else now_s
            else:
                now_s = (time.monotonic() - started_s) * speed
            module.advance(now_s)
            while out := module.data_to_send():
                transport.write(out)
            if module.has_hung_up:
                transport.close()
                return


def connect(make: Callable[[], SimulatedModule], speed: float | None) -> MemoryTransport:
    """Return a transport to a new module that runs in a thread of this process.

    Parameters
    ----------
    make : callable
        Makes the module.
    speed : float or None
        As in `serve`.

    Returns
    -------
    MemoryTransport
        The host's end; closing it ends the thread.
    """
    near, far = memory_pair()

    def run() -> None:
        try:
            serve(make(), far, speed=speed)
        finally:
            # Whatever ended the module, its host must see a closed port, not a silent one.
            far.close()

    threading.Thread(target=run, name="sim-module", daemon=True).start()
    return near
