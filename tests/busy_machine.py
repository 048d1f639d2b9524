"""Daemons and simulated modules that may be as slow as a busy machine makes them.

A module waits where it would lose frames, its host is patient, a daemon stays online and waits
for its threads, and its last resort, which would end the process, is taken from it.

    python -m tests.busy_machine ARGUMENTS    runs radard so
"""

import sys
import threading
import time
from functools import partial
from types import SimpleNamespace

import pytest


class PatientClock(threading.local):
    """A clock for each thread, on which no pause lasts longer than 60 ms."""

    def __init__(self):
        self._seen_s = self._now_s = time.monotonic()

    def monotonic(self):
        seen_s = time.monotonic()
        self._now_s += min(seen_s - self._seen_s, 0.06)
        self._seen_s = seen_s
        return self._now_s


def allow_for_it(patch):
    from x2radar.device.link import Deadlines

    patch.setattr("x2radar.sim.module.host.time", PatientClock())
    patient = partial(Deadlines, reply_s=60.0, ready_s=60.0, stall_s=60.0)
    patch.setattr("x2radar.device.device.Deadlines", patient)
    patch.setattr("radard.run.sensor.STALE_S", 60.0)
    patch.setattr("radard.run.running._JOIN_S", 60.0)
    patch.setattr("radard.run.process._JOIN_S", 60.0)
    patch.setattr("radard.run.os_signals.os", SimpleNamespace(_exit=lambda _code: None))


if __name__ == "__main__":
    from radard.cli import main

    with pytest.MonkeyPatch.context() as the_patch:
        allow_for_it(the_patch)
        sys.exit(main())
