"""What campaigns start, a daemon; and what they say at the end."""

import argparse
import contextlib
import json
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from tests.processes import environ, started

SETTLE_S = 120.0  # for a daemon to end, on a busy machine
HARM = {
    "crashes": "a daemon, or a run, that ended otherwise than it should",
    "deadlocks": "a run that did not end",
    "unhandled": "an input met with an error that is not the project's own, or killed the process",
    "hangs": "an input that took too long",
    "over_memory": "an input that took too much memory",
    "gap_decisions": "a window with a gap or a jump that was judged as if whole",
    "silent_stalls": "nothing decided, or nothing said of what happened",
    "unrecovered": "not well again, or too late, after what happened",
    "uncounted": "missing frames that nobody counted",
    "lost_events": "not at every output, or no more in the store",
    "duplicate_events": "a number, a key or a row used twice; an alarm that came back as another",
    "lost_states": "armed or not, and an alarm that was on, were not as before",
    "unreadable": "a recording, or a clip of an event, that is not there or cannot be read",
    "decisions_differ": "from those where nothing happened, or of a replay",
}
"""What no campaign may find; the last line of each counts all of them."""
CONFIG: Mapping[str, Any] = {
    "alarm": {"sensitivity": "high"},
    "log": {"first_retry_s": 0.2, "longest_retry_s": 1.0},
    "model": {"name": "fast"},
}
"""Of a daemon that tells of much, and tries again soon."""
_RADARD = "import sys; from radard.cli import main; sys.exit(main())"


def parser_of(doc: str | None) -> argparse.ArgumentParser:
    """Return a parser with a campaign's docstring as its help, and what it counts as harm."""
    harm = "\n".join(f"{key}: {what}" for key, what in HARM.items())
    plain = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(description=doc, epilog=harm, formatter_class=plain)


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

    def status(self) -> dict[str, Any]:
        """Return what its status file says; empty without one."""
        with contextlib.suppress(OSError, ValueError):
            return dict(json.loads((self.folder / "radar.status.json").read_text()))
        return {}

    def stop(self) -> int:
        """End it as a user would; return its exit code, -9 if it had to be killed."""
        self.process.terminate()
        try:
            return self.process.wait(SETTLE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()
