"""Cases of what may happen around a daemon: to its broker, processor, model and configuration.

Each case starts a daemon on a simulated module, does its worst, and takes it back. Then the daemon
must be online again, without having been started again, and every event be at every output.
"""

import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from campaigns.kept import House
from campaigns.processes import CONFIG, SETTLE_S, Daemon
from tests.processes import ROOT
from tests.waiting import wait_for

_PORT = "sim:human"


class Guard(House):
    """A daemon with outputs, and what happens around it."""

    is_full = False

    def hold(self, short_s: float, full_s: float) -> None:
        """Let it last."""
        time.sleep(full_s if self.is_full else short_s)

    def freeze(self, process: subprocess.Popen[str], short_s: float, full_s: float) -> None:
        """Stop a process for a while."""
        process.send_signal(signal.SIGSTOP)
        self.hold(short_s, full_s)
        process.send_signal(signal.SIGCONT)

    def reload(self, config: Mapping[str, Any] | str) -> None:
        """Write a configuration, or a text that is none, and ask for it to be read."""
        if isinstance(config, str):
            self.daemon.config_file.write_text(config)
        else:
            self.daemon.configure(config)
        self.daemon.process.send_signal(signal.SIGHUP)

    def revive(self) -> None:
        """Give up: a daemon that had to be started again is not well."""
        msg = "it ended"
        raise RuntimeError(msg)


def broker_down(guard: Guard) -> None:
    """Take the broker away for a while."""
    guard.broker.stop()
    reason = lambda: guard.daemon.status().get("reason", "")  # noqa: E731
    guard.expect("silent_stalls", "not a word of the broker", lambda: "mqtt" in reason())
    guard.hold(2, 60)
    guard.broker.start()


def broker_slow(guard: Guard) -> None:
    """Hold the broker: it takes connections and answers nothing."""
    guard.freeze(guard.broker.process, 6, 60)


def broker_flapping(guard: Guard) -> None:
    """Let the broker come and go."""
    for k in range(10 if guard.is_full else 3):
        guard.broker.stop()
        time.sleep(0.3 + 0.3 * (k % 3))
        guard.broker.start()
        time.sleep(0.5 * (k % 4))


def store_locked(guard: Guard) -> None:
    """Lock the store, as another program might."""
    with closing(sqlite3.connect(guard.store, timeout=30, isolation_level=None)) as db:
        db.execute("BEGIN EXCLUSIVE")
        guard.hold(4, 60)
        db.execute("ROLLBACK")


def stopped(guard: Guard) -> None:
    """Stop the process for a while."""
    guard.freeze(guard.daemon.process, 8, 30)


def starved(guard: Guard) -> None:
    """Let other programs have all processors, and come first."""
    burn = [sys.executable, "-c", "while True: pass"]
    os.setpriority(os.PRIO_PROCESS, guard.daemon.process.pid, 19)
    burners = [subprocess.Popen(burn) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        guard.hold(5, 30)
    finally:
        for each in burners:
            each.kill()
            each.wait()


def model_replaced(guard: Guard) -> None:
    """Give it a model of its own, and replace its files: by garbage, then by good ones."""
    own = guard.home / "own.onnx"
    good = [(ROOT / "models" / f"fast{suffix}").read_bytes() for suffix in (".onnx", ".json")]
    for learn_s, files in ((20.5, good), (21.0, [b"\x00garbage" * 100] * 2), (21.5, good)):
        for suffix, data in zip((".onnx", ".json"), files, strict=True):
            own.with_suffix(suffix).write_bytes(data)
        guard.goes_on(3)
        guard.reload({**CONFIG, "model": {"name": str(own)}, "gate": {"learn_s": learn_s}})
        guard.goes_on(3)


def reload_broken(guard: Guard) -> None:
    """Let it read a broken configuration again, then a good one."""
    for broken in ("alarm: {sensitivity: loud}\n", "alarm: [", "\x00"):
        guard.reload(broken)
        guard.goes_on(1)
    wait_for(lambda: "old configuration stays" in guard.daemon.log)
    guard.reload({**CONFIG, "alarm": {"sensitivity": "low"}})
    wait_for(lambda: guard.daemon.status().get("sensitivity") == "low")


def two_daemons(guard: Guard) -> None:
    """Start a second daemon on the same state directory."""
    state = {"service": {"state_dir": str(guard.home / "state")}}
    second = Daemon(guard.root / "second", "--port", _PORT, "-o", "null", config=state)
    code = second.process.wait(SETTLE_S)
    if code != 78 or "another radard" not in second.log:
        guard.note("unrecovered", f"the second daemon ended with {code}: {second.log}")


CASES: Mapping[str, Callable[[Guard], None]] = {
    case.__name__: case
    for case in (
        *(broker_down, broker_slow, broker_flapping, store_locked),
        *(stopped, starved, model_replaced, reload_broken, two_daemons),
    )
}


def surrounded(names: Iterable[str], *, is_full: bool) -> dict[str, dict[str, Any]]:
    """Run cases, each around a broker and a daemon of its own; return what each one counted."""
    found: dict[str, dict[str, Any]] = {}
    for name in names:
        begun_s = time.monotonic()
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            guard = Guard(Path(folder), random.Random(), stack)  # noqa: S311 - draws nothing
            guard.is_full = is_full
            guard.start("--port", _PORT)
            try:
                guard.goes_on(1)
                CASES[name](guard)
                guard.goes_on(3)
                guard.expect("unrecovered", name, lambda: guard.state_is("online"))  # noqa: B023
                guard.counts["events"] = len(guard.kept())
                guard.let_arrive()
            except (AssertionError, RuntimeError) as err:
                guard.note("unrecovered", f"{name}: {err}\n{guard.daemon.log[-2000:]}")
            guard.stop()
            guard.counts["seconds"] = round(time.monotonic() - begun_s)
            found[name] = {**guard.found, **guard.counts}
    return found
