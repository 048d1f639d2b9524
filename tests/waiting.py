"""What keeps tests deterministic: waiting, free ports, processes that can be interrupted."""

import os
import random
import socket
import time


def wait_for(condition, timeout_s=180.0, explain=lambda: ""):
    """Return what `condition` returns once that is true; fail if it never is."""
    end_s = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < end_s, f"waited in vain: {explain()}"
        time.sleep(0.004)
    return found


def free_port():
    """Return a TCP port that nobody uses, below those that the system hands out by itself."""
    draw = random.SystemRandom()
    while True:
        port = draw.randrange(10_000, 32_000)
        with socket.socket() as sock:
            try:
                sock.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port


def unmeasured():
    """Return the environment of a process that a signal is to end in the midst of its work.

    coverage.py takes a lock at calls; an interrupt within it keeps the lock, and nothing ends.
    """
    return {k: v for k, v in os.environ.items() if not k.startswith("COVERAGE_")}
