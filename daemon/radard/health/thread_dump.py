"""What to do with threads that hang: say where they are, and end in spite of them."""

import json
import logging
import os
import sys
import threading
from collections.abc import Mapping
from typing import Any

from radard.health.health import Health

log = logging.getLogger("radard")


def stacks() -> dict[str, str]:
    """Return the file and line at which every thread is, by the threads' names."""
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    return {
        names.get(ident, str(ident)): f"{frame.f_code.co_filename}:{frame.f_lineno}"
        for ident, frame in sys._current_frames().items()
    }


def state_of(health: Health, panel: Mapping[str, Any]) -> dict[str, Any]:
    """Return the state of one sensor's run."""
    status = health.status
    return {
        "state": status.state,
        "reason": status.reason,
        "decision_age_s": round(health.age_s, 1),
        **panel,
    }


def state_dump(states: Mapping[str, Any]) -> str:
    """Return all of a process's state, and where its threads are, as one line of JSON."""
    return json.dumps({**states, "threads": stacks()})


def force_after(seconds: float) -> threading.Timer:
    """End the process unless the timer that is returned is cancelled before."""

    def force() -> None:
        log.error("not ended in %g s, forced; threads: %s", seconds, json.dumps(stacks()))
        os._exit(1)

    timer = threading.Timer(seconds, force)
    timer.daemon = True
    timer.start()
    return timer
