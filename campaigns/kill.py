"""SIGKILL at random moments while the daemon records, stores and publishes.

    python campaigns/kill.py --kills 200
    python campaigns/kill.py --kills 4       # the short form

A daemon on a simulated module with people in it is killed and started again on the same state
directory, store and broker; every other kill comes within 20 ms of an event. In between it is
armed and disarmed. A recording may lack a second before the last decision. The last line is one
JSON object: kills, events, decisions (those compared with a run that nobody killed) and the harm,
which gives exit code 1.
"""

import random
import sys
import time
from contextlib import ExitStack
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from campaigns.kept import BUSY, House, campaign
from x2radar.errors import RecordingError
from x2radar.recording.registry import open_recording

_ALIVE_S = (0.3, 4.0)
_CONFIG = {
    **BUSY,
    # An alarm that is on stays on until somebody disarms.
    "alarm": {"sensitivity": "high", "latch_s": 3600},
}


class Killed(House):
    """A daemon that is killed, and what must outlive it."""

    config = _CONFIG

    def __init__(self, folder: Path, rng: random.Random, stack: ExitStack) -> None:
        super().__init__(folder, rng, stack)
        self._recording, self._n_before = folder / "rec.h5", 0
        self._is_armed = True
        self._open_alarm: str | None = None
        self._over: set[str] = set()

    def once(self, k: int) -> None:
        """Start it, let it live a while, kill it, and look at what it left."""
        self._begin(k)
        try:
            if self.rng.random() < 0.5:
                self._command()
            self._live(k)
        finally:
            self.daemon.process.kill()
            self.daemon.process.wait()
        self._look_at_recording(k)
        self._open_alarm = None
        for row in self.records("event"):
            if row["kind"] == "alarm" and row["id"] not in self._over:
                self._open_alarm = None if row["phase"] == "end" else row["id"]

    def finish(self) -> None:
        """Start it for the last time, until every event has arrived."""
        self._begin(-1)
        super().finish()

    def _begin(self, k: int) -> None:
        self._n_before = self.n_told("decision")
        self.start("--record", str(self._recording))
        self.goes_on(1, f"start {k}")
        self._check_state(k)

    def _live(self, k: int) -> None:
        """Let it live: for a random time, or until just behind the next event."""
        end_s = time.monotonic() + self.rng.uniform(*_ALIVE_S)
        if k % 2 == 0:
            n_before = self.n_told("event")
            while time.monotonic() < end_s + 5 and self.daemon.is_alive:
                if self.n_told("event") > n_before:
                    end_s = time.monotonic() + self.rng.uniform(0, 0.02)
                    break
                time.sleep(0.002)
        time.sleep(max(0.0, end_s - time.monotonic()))

    def _command(self) -> None:
        """Disarm or arm it; what it says that it did must hold from then on."""
        wanted = not self._is_armed
        answer = self.ask("arm" if wanted else "disarm")
        if answer.get("ok") and answer.get("armed") is wanted:
            self._is_armed = wanted
            # Whatever was on is over, although the kill may come before that is told.
            self._over |= {row["id"] for row in self.records("event")}

    def _check_state(self, k: int) -> None:
        """Compare what it says after the start with what held when it was killed."""
        self.wait_status()
        status = self.daemon.status()
        was = f"start {k}: armed {self._is_armed}, {self._open_alarm} on before: {status}"
        if status.get("armed") is not self._is_armed:
            self.note("lost_states", was)
        if self._open_alarm not in {None, status.get("alarm_id")}:
            self.note("duplicate_events" if status.get("alarm_id") else "lost_states", was)
            self._over.add(str(self._open_alarm))

    def _look_at_recording(self, k: int) -> None:
        # Behind the last one that had its frames there may be nothing to record.
        made = list(self.records("decision"))[self._n_before :]
        last = [row for row in made if row["gate"] != "invalid"][-1:] or made[:1]
        try:
            with open_recording(self._recording) as reader:
                rate_hz = reader.stream.frame_rate_hz
                end_s = max(frame.index + 1 for frame in reader.frames()) / rate_hz
        except RecordingError as err:
            self.note("unreadable", f"recording {k}: {err}")
            return
        finally:
            self._recording.unlink(missing_ok=True)
        # A second of frames: it lasts longer where some of them never came.
        if end_s < last[0]["t_s"] - 1.0 - last[0]["dropped"] / rate_hz:
            self.note("unreadable", f"recording {k}: ends at {end_s}, decided {last[0]}")


if __name__ == "__main__":
    sys.exit(campaign(__doc__, "kills", Killed))
