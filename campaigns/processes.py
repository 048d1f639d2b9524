"""What campaigns start, a daemon; and what they say at the end."""

import argparse
import contextlib
import json
import subprocess
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from tests.processes import environ, started

PATIENCE_S = 120.0
"""For anything that a busy machine delays."""
HARM = (
    *("crashes", "deadlocks", "unhandled", "hangs", "over_memory", "gap_decisions"),
    *("silent_stalls", "unrecovered", "uncounted", "lost_events", "duplicate_events"),
    *("lost_states", "unreadable", "decisions_differ"),
)
"""What no campaign may find; the last line of each says all of them."""
CONFIG: Mapping[str, Any] = {
    "alarm": {"sensitivity": "high"},
    "log": {"first_retry_s": 0.2, "longest_retry_s": 1.0},
    "model": {"name": "fast"},
}
"""Of a daemon that tells of much, and tries again soon."""
_RADARD = "import sys; from radard.cli import main; sys.exit(main())"


def parser_of(doc: str | None) -> argparse.ArgumentParser:
    """Return a parser whose help begins and ends as a campaign's docstring does."""
    paragraphs = (doc or "").split("\n\n")
    return argparse.ArgumentParser(description=paragraphs[0], epilog=paragraphs[-1])


def wait_for(condition: Callable[[], Any], what: str, timeout_s: float = PATIENCE_S) -> Any:
    """Return what `condition` returns once that is true; raises TimeoutError."""
    end_s = time.monotonic() + timeout_s
    while not (found := condition()):
        if time.monotonic() > end_s:
            msg = f"waited in vain for {what}"
            raise TimeoutError(msg)
        time.sleep(0.02)
    return found


def end_with(found: Mapping[str, Any]) -> int:
    """Print a campaign's last line; return its exit code: 1 where something did harm."""
    line = {**dict.fromkeys(HARM, 0), **found}
    print(json.dumps(line))
    return int(any(line[key] for key in HARM))


class Daemon:
    """A `radard` process in a folder of its own: configuration, state, status and log.

    `before` is code that it runs first.
    """

    def __init__(
        self,
        folder: Path,
        *arguments: str,
        config: Mapping[str, Any] | None = None,
        before: str = "",
    ) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self.config_file = folder / "config.yaml"
        self.configure(config or {})
        env = {k: v for k, v in environ().items() if not k.startswith(("RADARD_", "NOTIFY_"))}
        env |= dict.fromkeys(("XDG_STATE_HOME", "XDG_RUNTIME_DIR"), str(folder))
        env |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        command = ("-c", f"{before}\n{_RADARD}", "--config", self.config_file, *arguments)
        with (folder / "log").open("ab") as log:
            given = {"stdout": subprocess.DEVNULL, "stderr": log, "env": env, "cwd": folder}
            self.process = started(*command, **given)

    def configure(self, config: Mapping[str, Any]) -> None:
        """Write the configuration file; state and status are kept in the folder."""
        service = {"state_dir": str(self.folder / "state"), "runtime_dir": str(self.folder)}
        service |= config.get("service", {})
        self.config_file.write_text(yaml.safe_dump({**config, "service": service}))

    @property
    def is_alive(self) -> bool:
        """Whether it runs."""
        return self.process.poll() is None

    @property
    def log(self) -> str:
        """What it has logged."""
        return (self.folder / "log").read_text(errors="replace")

    def status(self, sensor: str = "radar") -> dict[str, Any]:
        """Return what its status file says; empty without one."""
        with contextlib.suppress(OSError, ValueError):
            return dict(json.loads((self.folder / f"{sensor}.status.json").read_text()))
        return {}

    def wait_state(self, state: str, word: str = "") -> None:
        """Wait until its status file shows a state, with a word in its reason."""

        def is_shown() -> bool:
            if not self.is_alive:
                msg = f"it ended: {self.log[-500:]}"
                raise RuntimeError(msg)
            status = self.status()
            return status.get("state") == state and word in status.get("reason", "")

        wait_for(is_shown, f"{state} {word!r}")

    def stop(self) -> int:
        """End it as a user would; return its exit code, -9 if it had to be killed."""
        self.process.terminate()
        try:
            return self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()
