"""SIGKILL at random moments while the daemon records, stores and publishes.

    python campaigns/kill.py --kills 200
    python campaigns/kill.py --kills 4       # the short form

A daemon on a simulated module with people in it is killed and started again on the same state
directory, store and broker; every other kill comes within 20 ms of an event. In between it is
armed and disarmed. The last line is one JSON object: kills; lost_events (events that one output
has told of, and that at last are missing from the store or never came to the broker);
duplicate_events (an alarm that was on when the daemon was killed and came back under another
id, or an event with two rows in the store); unreadable (recordings that cannot be read, or lack
more than a second before the last decision); lost_states (armed or not, an alarm that was on).
Exit code 1 if one of them but kills is not 0.
"""

import argparse
import contextlib
import importlib
import json
import os
import random
import signal
import sqlite3
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(_ROOT), str(_ROOT / "daemon")]
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

# All that the daemon will need: what is imported here costs a start nothing.
for _name in (
    *("h5py", "paho.mqtt.client", "radard.judge.onnx_runtime", "radard.run.process"),
    *("radard.outputs.mqtt.sink", "radard.outputs.store", "x2radar.recording.hdf5_writer"),
):
    importlib.import_module(_name)

from campaigns.processes import Broker, wait_for  # noqa: E402 - below the path
from radard.cli import main as radard_main  # noqa: E402
from radard.run.control import ask, control_path  # noqa: E402
from x2radar.errors import RecordingError  # noqa: E402
from x2radar.recording.registry import open_recording  # noqa: E402

_SPEED = 4
"""Stream seconds a second: more happens between two kills."""
_ALIVE_S = (0.3, 4.0)
_CONFIG = {
    "sensor": {"port": "sim:human", "speed": str(_SPEED), "wait": True},
    # An alarm that is on stays on until somebody disarms.
    "alarm": {"sensitivity": "high", "latch_s": 3600},
    "log": {"first_retry_s": 0.2, "longest_retry_s": 1.0},
    "model": {"name": "fast"},
}


class Forked:
    """A daemon in a child of this process, which has imported everything for it."""

    def __init__(self, folder: Path, arguments: list[str]) -> None:
        self.folder = folder
        self.pid = os.fork()
        if self.pid == 0:
            code = 70
            with contextlib.suppress(BaseException):
                code = self._run(arguments)
            os._exit(code)

    def _run(self, arguments: list[str]) -> int:
        os.chdir(self.folder)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        log = os.open("log", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        null = os.open(os.devnull, os.O_RDWR)
        for fd, to in ((null, 0), (null, 1), (log, 2)):
            os.dup2(fd, to)
        sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False)
        try:
            return radard_main(arguments)
        except SystemExit as stop:
            return stop.code if isinstance(stop.code, int) else 1

    @property
    def is_alive(self) -> bool:
        """Whether it runs."""
        return os.waitpid(self.pid, os.WNOHANG) == (0, 0)

    def end(self, number: int) -> None:
        """Send it a signal and wait for its end."""
        os.kill(self.pid, number)
        os.waitpid(self.pid, 0)


class House:
    """What outlives the daemon, and what it must hold."""

    def __init__(self, folder: Path, broker: Broker, rng: random.Random) -> None:
        self._folder, self._broker, self._rng = folder, broker, rng
        self._out, self._store = folder / "out.jsonl", folder / "radard.db"
        self._n = 0
        self._is_armed = True
        self._open_alarm: str | None = None
        self._over: set[str] = set()
        self.found = dict.fromkeys(("duplicate_events", "unreadable", "lost_states"), 0)
        config = {**_CONFIG, "service": {"state_dir": "state", "runtime_dir": "."}}
        (folder / "config.yaml").write_text(json.dumps(config))

    def kill_once(self) -> None:
        """Start it, let it live a while, kill it, and look at what it left."""
        daemon = self._started()
        try:
            self._check_state(daemon.pid)
            if self._rng.random() < 0.5:
                self._command()
            self._live(daemon)
        finally:
            daemon.end(signal.SIGKILL)
        self._look_at_recording()
        self._open_alarm = self._alarm_that_is_on()

    def finish(self) -> None:
        """Start it for the last time, until every event has arrived."""
        daemon = self._started()
        try:
            self._check_state(daemon.pid)
            with contextlib.suppress(TimeoutError):
                wait_for(lambda: not self._missing_at_broker(), "events at the broker")
        finally:
            daemon.end(signal.SIGTERM)

    def lost(self) -> int:
        """Return how many events are not where they should be."""
        told = {row["id"] for row in self._told()} | {row["id"] for row in self._broker.events()}
        missing = self._missing_at_broker()
        unkept = told - set(self._kept())
        for event_id in missing | unkept:
            print(f"lost: {event_id}: {missing=} {unkept=}", file=sys.stderr)
        return len(missing | unkept)

    def _started(self) -> Forked:
        self._n += 1
        outputs = [f"json:{self._out}", f"store:{self._store}", self._broker.url]
        arguments = ["--config", "config.yaml", "--record", str(self._recording)]
        arguments += [word for output in outputs for word in ("-o", output)]
        n_before = len(self._lines())
        daemon = Forked(self._folder, arguments)

        def is_at_work() -> bool:
            if not daemon.is_alive:
                log = (self._folder / "log").read_text()[-800:]
                msg = f"it does not start: {log}"
                raise RuntimeError(msg)
            return any('"type":"decision"' in line for line in self._lines()[n_before:])

        wait_for(is_at_work, "a decision")
        return daemon

    @property
    def _recording(self) -> Path:
        return self._folder / f"rec{self._n}.h5"

    def _live(self, daemon: Forked) -> None:
        """Let it live: for a random time, or until just behind the next event."""
        end_s = time.monotonic() + self._rng.uniform(*_ALIVE_S)
        if self._n % 2:
            n_before = len(self._told())
            while time.monotonic() < end_s + 5 and daemon.is_alive:
                if len(self._told()) > n_before:
                    end_s = time.monotonic() + self._rng.uniform(0, 0.02)
                    break
                time.sleep(0.002)
        time.sleep(max(0.0, end_s - time.monotonic()))

    def _command(self) -> None:
        """Disarm or arm it; what it says that it did must hold from then on."""
        wanted = not self._is_armed
        sock = control_path(self._folder, "radar")
        wait_for(sock.exists, "the control socket")
        with contextlib.suppress(OSError, ValueError):
            answer = ask(sock, "arm" if wanted else "disarm")
            if answer.get("ok") and answer.get("armed") is wanted:
                self._is_armed = wanted
                # Whatever was on is over, although the kill may come before that is told.
                self._over |= {row["id"] for row in self._told()}

    def _check_state(self, pid: int) -> None:
        """Compare what it says after the start with what held when it was killed."""
        path = self._folder / "radar.status.json"
        # The file of the one that was killed is still there.
        wait_for(lambda: path.exists() and json.loads(path.read_text())["pid"] == pid, "a status")
        text = path.read_text()
        status = json.loads(text)
        if status.get("armed") is not self._is_armed:
            self.found["lost_states"] += 1
            print(f"start {self._n}: armed should be {self._is_armed}: {text}", file=sys.stderr)
        if self._open_alarm is not None:
            now_on = status.get("alarm_id")
            if now_on is None:
                self.found["lost_states"] += 1
            elif now_on != self._open_alarm:
                self.found["duplicate_events"] += 1
            if now_on != self._open_alarm:
                print(f"start {self._n}: {self._open_alarm} was on: {text}", file=sys.stderr)
                self._over.add(self._open_alarm)

    def _look_at_recording(self) -> None:
        # Behind the last one that had its frames there may be nothing to record.
        made = [row for row in self._rows() if row["type"] == "decision"]
        last = [row for row in made if row["gate"] != "invalid"][-1:] or made[:1]
        try:
            with open_recording(self._recording) as reader:
                rate_hz = reader.stream.frame_rate_hz
                end_s = max(frame.index + 1 for frame in reader.frames()) / rate_hz
        except RecordingError as err:
            self.found["unreadable"] += 1
            print(f"recording {self._n}: {err}", file=sys.stderr)
            return
        self._recording.unlink()
        # A second of frames: it lasts longer where some of them never came.
        if end_s < last[0]["t_s"] - 1.0 - last[0]["dropped"] / rate_hz:
            self.found["unreadable"] += 1
            print(f"recording {self._n}: ends at {end_s}, decided {last[0]}", file=sys.stderr)

    def _alarm_that_is_on(self) -> str | None:
        on: str | None = None
        for row in self._told():
            if row["kind"] == "alarm" and row["id"] not in self._over:
                on = None if row["phase"] == "end" else row["id"]
        return on

    def _missing_at_broker(self) -> set[str]:
        came = {row["id"] for row in self._broker.events()}
        return ({row["id"] for row in self._told()} | set(self._kept())) - came

    def _kept(self) -> list[str]:
        with closing(sqlite3.connect(self._store, timeout=30)) as db:
            return [row[0] for row in db.execute("SELECT id FROM events")]

    def _lines(self) -> list[str]:
        return self._out.read_text().splitlines() if self._out.exists() else []

    def _rows(self) -> Iterator[dict[str, Any]]:
        for line in self._lines():
            # The last line of a run that was killed may be torn.
            with contextlib.suppress(ValueError):
                yield json.loads(line)

    def _told(self) -> list[dict[str, Any]]:
        return [row for row in self._rows() if row.get("type") == "event"]


def main() -> int:
    """Kill again and again."""
    about = (__doc__ or "").split("\n\n")
    parser = argparse.ArgumentParser(description=about[0], epilog=about[2])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--most-minutes", type=float, default=float("inf"), help="end sooner")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    rng = random.Random(args.seed)  # noqa: S311 - no secret
    with tempfile.TemporaryDirectory() as made, Broker(Path(made)) as broker:
        house = House(Path(made), broker, rng)
        n, end_s = 0, time.monotonic() + args.most_minutes * 60
        while n < args.kills and time.monotonic() < end_s:
            house.kill_once()
            n += 1
        house.finish()
        events = {row["id"] for row in broker.events()}
        found = {"kills": n, "lost_events": house.lost(), **house.found}
    print(json.dumps({**found, "events": len(events)}))
    return 1 if any(value for key, value in found.items() if key != "kills") else 0


if __name__ == "__main__":
    sys.exit(main())
