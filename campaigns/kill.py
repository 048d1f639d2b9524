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
Exit code 1 if harm was found.
"""

import contextlib
import random
import sys
import tempfile
import time
from pathlib import Path

_ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(_ROOT), str(_ROOT / "daemon")]

from campaigns.outputs import Broker, Outputs  # noqa: E402 - below the path
from campaigns.processes import CONFIG, Daemon, end_with, parser_of, wait_for  # noqa: E402
from radard.run.control import ask, control_path  # noqa: E402
from x2radar.errors import RecordingError  # noqa: E402
from x2radar.recording.registry import open_recording  # noqa: E402

_ALIVE_S = (0.3, 4.0)
_CONFIG = {
    **CONFIG,
    # Stream seconds a second: more happens between two kills.
    "sensor": {"port": "sim:human", "speed": "4", "wait": True},
    # An alarm that is on stays on until somebody disarms.
    "alarm": {"sensitivity": "high", "latch_s": 3600},
}


class House:
    """What outlives the daemon, and what it must hold."""

    def __init__(self, folder: Path, broker: Broker, rng: random.Random) -> None:
        self._folder, self._rng = folder, rng
        self._outputs = Outputs(folder, broker)
        self._n = self._n_before = 0
        self._is_armed = True
        self._open_alarm: str | None = None
        self._over: set[str] = set()
        self.found = dict.fromkeys(
            ("lost_events", "duplicate_events", "unreadable", "lost_states"), 0
        )

    def kill_once(self) -> None:
        """Start it, let it live a while, kill it, and look at what it left."""
        daemon = self._started()
        try:
            self._check_state(daemon)
            if self._rng.random() < 0.5:
                self._command(daemon)
            self._live(daemon)
        finally:
            daemon.kill()
        self._look_at_recording()
        self._open_alarm = self._alarm_that_is_on()

    def finish(self) -> int:
        """Start it for the last time, until every event has arrived; return how many there are."""
        daemon = self._started()
        try:
            self._check_state(daemon)
            self.found["lost_events"] = self._outputs.lost()
        finally:
            daemon.stop()
        kept = self._outputs.kept()
        self.found["duplicate_events"] += len(kept) - len(set(kept))
        return len(kept)

    def _started(self) -> Daemon:
        self._n += 1
        arguments = ["--record", str(self._recording), *self._outputs.arguments]
        self._n_before = n_before = self._n_told("decision")
        daemon = Daemon(self._folder / "radard", *arguments, config=_CONFIG)

        def is_at_work() -> bool:
            if not daemon.is_alive:
                msg = f"it does not start: {daemon.log[-800:]}"
                raise RuntimeError(msg)
            return self._n_told("decision") > n_before

        try:
            wait_for(is_at_work, "a decision")
        except TimeoutError:
            daemon.kill()
            raise
        return daemon

    @property
    def _recording(self) -> Path:
        return self._folder / f"rec{self._n}.h5"

    def _live(self, daemon: Daemon) -> None:
        """Let it live: for a random time, or until just behind the next event."""
        end_s = time.monotonic() + self._rng.uniform(*_ALIVE_S)
        if self._n % 2:
            n_before = self._n_told("event")
            while time.monotonic() < end_s + 5 and daemon.is_alive:
                if self._n_told("event") > n_before:
                    end_s = time.monotonic() + self._rng.uniform(0, 0.02)
                    break
                time.sleep(0.002)
        time.sleep(max(0.0, end_s - time.monotonic()))

    def _n_told(self, kind: str) -> int:
        return sum(1 for _ in self._outputs.records(kind))

    def _command(self, daemon: Daemon) -> None:
        """Disarm or arm it; what it says that it did must hold from then on."""
        wanted = not self._is_armed
        sock = control_path(daemon.folder, "radar")
        wait_for(sock.exists, "the control socket")
        with contextlib.suppress(OSError, ValueError):
            answer = ask(sock, "arm" if wanted else "disarm")
            if answer.get("ok") and answer.get("armed") is wanted:
                self._is_armed = wanted
                # Whatever was on is over, although the kill may come before that is told.
                self._over |= {row["id"] for row in self._outputs.records("event")}

    def _check_state(self, daemon: Daemon) -> None:
        """Compare what it says after the start with what held when it was killed."""
        # The file of the one that was killed is still there.
        wait_for(lambda: daemon.status().get("pid") == daemon.process.pid, "a status")
        status = daemon.status()
        now_on = status.get("alarm_id")
        self.found["lost_states"] += status.get("armed") is not self._is_armed
        if self._open_alarm not in {None, now_on}:
            self.found["lost_states" if now_on is None else "duplicate_events"] += 1
            self._over.add(str(self._open_alarm))
        elif status.get("armed") is self._is_armed:
            return
        was = f"armed {self._is_armed}, {self._open_alarm} on"
        print(f"start {self._n}: {was} before: {status}", file=sys.stderr)

    def _look_at_recording(self) -> None:
        # Behind the last one that had its frames there may be nothing to record.
        made = list(self._outputs.records("decision"))[self._n_before :]
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
        for row in self._outputs.records("event"):
            if row["kind"] == "alarm" and row["id"] not in self._over:
                on = None if row["phase"] == "end" else row["id"]
        return on


def main() -> int:
    """Kill again and again."""
    parser = parser_of(__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    rng = random.Random(args.seed)  # noqa: S311 - no secret
    with tempfile.TemporaryDirectory() as made, Broker(Path(made)) as broker:
        house = House(Path(made), broker, rng)
        for _ in range(args.kills):
            house.kill_once()
        events = house.finish()
    return end_with({"kills": args.kills, "events": events, **house.found})


if __name__ == "__main__":
    sys.exit(main())
