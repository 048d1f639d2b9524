"""What campaigns start, a daemon and a page that looks on, and what they say at the end."""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[1]
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


def environment(folder: Path) -> dict[str, str]:
    """Return an environment with this source tree and folders of its own."""
    paths = (ROOT, ROOT / "daemon", ROOT / "training")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("RADARD_", "NOTIFY_"))}
    return {
        **kept,
        "PYTHONPATH": os.pathsep.join(map(str, paths)),
        "XDG_STATE_HOME": str(folder),
        "XDG_RUNTIME_DIR": str(folder),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


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
        self.log_file = folder / "log"
        self.arguments = arguments
        self._before = before
        self.process: subprocess.Popen[bytes] | None = None

    def configure(self, config: Mapping[str, Any]) -> None:
        """Write the configuration file; state and status are kept in the folder."""
        service = {"state_dir": str(self.folder / "state"), "runtime_dir": str(self.folder)}
        self.config_file.write_text(
            yaml.safe_dump({**config, "service": {**service, **config.get("service", {})}})
        )

    def start(self) -> "Daemon":
        """Start it, again if it was killed."""
        code = f"{self._before}\n{_RADARD}"
        command = [sys.executable, "-c", code, "--config", str(self.config_file)]
        with self.log_file.open("ab") as log:
            self.process = subprocess.Popen(
                [*command, *self.arguments],
                stdout=subprocess.DEVNULL,
                stderr=log,
                env=environment(self.folder),
                cwd=self.folder,
            )
        return self

    def __enter__(self) -> "Daemon":
        """Start it."""
        return self.start()

    def __exit__(self, *_error: object) -> None:
        """End it."""
        self.stop()

    @property
    def pid(self) -> int:
        """Its process id."""
        assert self.process is not None
        return self.process.pid

    @property
    def is_alive(self) -> bool:
        """Whether it runs."""
        return self.process is not None and self.process.poll() is None

    @property
    def log(self) -> str:
        """What it has logged."""
        return self.log_file.read_text(errors="replace") if self.log_file.exists() else ""

    def status(self, sensor: str = "radar") -> dict[str, Any]:
        """Return what its status file says; empty without one."""
        with contextlib.suppress(OSError, ValueError):
            status: dict[str, Any] = json.loads(
                (self.folder / f"{sensor}.status.json").read_text()
            )
            return status
        return {}

    def wait_state(self, state: str, word: str = "", sensor: str = "radar") -> dict[str, Any]:
        """Wait until its status file shows a state, with a word in its reason."""

        def shown() -> dict[str, Any]:
            if not self.is_alive:
                msg = f"it ended: {self.log[-500:]}"
                raise RuntimeError(msg)
            status = self.status(sensor)
            fits = status.get("state") == state and word in status.get("reason", "")
            return status if fits else {}

        found: dict[str, Any] = wait_for(shown, f"{state} {word!r}")
        return found

    def send(self, number: int) -> None:
        """Send it a signal."""
        os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill it."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        """End it as a user would; return its exit code, -9 if it had to be killed."""
        if self.process is None:
            return 0
        if self.process.poll() is None:
            self.process.terminate()
        try:
            return self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


class Page:
    """What a page does: it listens to the daemon's WebSocket and asks for its status."""

    def __init__(self, port: int, path: str = "") -> None:
        self.n_messages = 0
        self._address = f"127.0.0.1:{port}{path}"
        self._halt = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close the page."""
        self._halt.set()
        self._thread.join(10)

    def _run(self) -> None:
        from websockets.exceptions import WebSocketException  # noqa: PLC0415 - of the extra
        from websockets.sync.client import connect  # noqa: PLC0415

        while not self._halt.is_set():
            with contextlib.suppress(OSError, WebSocketException, TimeoutError, EOFError):
                origin: Any = f"http://{self._address.partition('/')[0]}"
                with connect(f"ws://{self._address}/ws", origin=origin) as line:
                    while not self._halt.is_set():
                        with contextlib.suppress(TimeoutError):
                            line.recv(timeout=1.0)
                            self.n_messages += 1
            self._halt.wait(0.5)
