"""One radar under faults: the driver, the ring and the worker, watched by what knows the truth.

The module writes into every frame when it was made (`stamp`), so the truth does not depend on
counters, which faults damage. `Watcher` follows the rows that the ring was given and says of every
decision whether its window was whole, of every loss whether it was counted, and at any time
whether the daemon stands still and says nothing.
"""

import contextlib
import math
import threading
from collections import Counter
from collections.abc import Callable
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.alarm.sensor_state import StateStore
from radard.config.config import load_config
from radard.config.quiet_hours import wall_clock
from radard.health.health import STALE_S, Health
from radard.judge.classifier import Classifier
from radard.judge.evidence import HOP_S
from radard.log import EventLog
from radard.outputs.records import Record
from radard.pipeline import Pipeline
from radard.run.components import make_parts
from radard.run.worker import Worker
from radard.stream.frame_timing import RateWatch
from radard.stream.ring import MAX_GAP_S, MAX_LOST, Dwell, Notice
from x2radar.device.device import X2Radar
from x2radar.device.link import Deadlines
from x2radar.device.reconnect import ReconnectingRadar
from x2radar.device.transport import Transport
from x2radar.frame import Frame, StreamInfo
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module.firmware import X2Firmware
from x2radar.wire.messages import Message

RECOVERY_S = 3.1  # stream time from the last bad frame to a whole decision; a dwell is 2.45 s long
SPIKED_S = 3.5  # the same after spikes: only the worker sees those, and keeps to its hops
OUTAGE_S = 7.0
"""From the end of all faults to good frames: a stall (1.5 s), an answer that does not come (2 s),
a pause before another opening (2 s), a reset with its boot (0.75 s), and less than a second."""
_LOOK_UP_S = 0.5
_SILENT_S = STALE_S + HOP_S + 2 * _LOOK_UP_S
_SCALE = 2.0**-18
_COPIES = 3


def stamp(samples: NDArray[np.float32], made_s: float) -> NDArray[np.float32]:
    """Return a frame that says in its first samples when it was made, to the millisecond.

    As values that a quiet frame may have, so that no decision depends on them: up to 64.
    """
    out = samples.copy()
    out[:_COPIES] = np.float32(round(made_s * 1000) * _SCALE)
    return out


def read_stamp(samples: NDArray[Any]) -> float | None:
    """Return when a frame was made, in seconds; None if its bytes were damaged on the way.

    XOR, the protocol's checksum, lets one of 256 damaged packets pass.
    """
    first = samples[:_COPIES]
    if not (np.isfinite(first).all() and (first == first[0]).all()):
        return None
    ms = float(first[0]) / _SCALE
    return ms / 1000 if ms == round(ms) and 0 <= ms < 1 << 24 else None


class StampingFirmware(X2Firmware):
    """An X2 whose frames say when they were made."""

    now_s: Callable[[], float]

    def frame_message(self, axis: Any, counter: int, frame: NDArray[Any]) -> Message:
        """As in `Firmware`."""
        return super().frame_message(axis, counter, stamp(frame, self.now_s()))


class Watcher:
    """Compare what the daemon says with the truth; `clock` has `now` and, in a run, `sleep`."""

    def __init__(self, n_slow: int, rate_hz: float, clock: Any) -> None:
        self.tally: Counter[str] = Counter()
        self.notes: list[str] = []
        self._rate_hz = rate_hz
        self._n_slow = n_slow
        self._clock = clock
        self._rows: list[float | None] = []
        self._known: tuple[int, float, float] | None = None
        self._whole_s = clock.now()
        self._is_silent = self._is_spiked = False
        self._t_s = 0.0
        # When the last bad frame was read, and its stream time; likewise of whole decisions.
        self.last_bad: tuple[float, float] | None = None
        self.wholes: list[tuple[float, float]] = []

    def frame(self, frame: Frame) -> None:
        """Take a frame as the driver gives it."""
        tally = self.tally
        made_s = read_stamp(frame.samples)
        tally["frames"] += 1
        self._t_s = frame.index / self._rate_hz
        tally["damaged_unseen"] += made_s is None
        if frame.restarted or not self._rows:
            self._known = None
        else:
            tally["lost"] += frame.lost
            self._rows += [None] * frame.lost
        self._rows.append(math.nan if made_s is None else made_s)
        if frame.lost or frame.restarted or made_s is None:
            self.last_bad = self._clock.now(), frame.index / self._rate_hz
        if made_s is None:
            return
        row = len(self._rows) - 1
        # Constant until the module's counter begins again.
        begun = made_s * self._rate_hz - frame.counter
        if self._known is not None:
            before, before_s, before_begun = self._known
            missing = round((made_s - before_s) * self._rate_hz) - (row - before)
            if missing and abs(begun - before_begun) > 0.5:
                # It began again among frames that were lost, so that its numbers seem to go on.
                tally["hidden_restarts"] += 1
            elif missing:
                tally["uncounted"] += abs(missing)
                self.notes.append(f"{missing} uncounted at {frame.index / self._rate_hz:.2f} s")
        self._known = row, made_s, begun

    def decision(self, dwell: Dwell, *, is_whole: bool) -> None:
        """Take a decision and the dwell that it was made on."""
        self.tally["decisions"] += 1
        if not is_whole:
            return
        now_s = self._clock.now()
        self._whole_s, self._is_silent = now_s, False
        self.wholes.append((now_s, dwell.t_s))
        rows = self._rows[dwell.end_frame - self._n_slow : dwell.end_frame]
        if why := _stitched(rows, self._rate_hz):
            self.tally["gap_decisions"] += 1
            self.notes.append(f"whole at {dwell.t_s:.2f} s: {why}")

    def look(self, *, is_announced: bool) -> None:
        """Look at the clock; note a stall of which nobody was told."""
        now_s = self._clock.now()
        if now_s - self._whole_s > _SILENT_S and not is_announced and not self._is_silent:
            self._is_silent = True
            self.tally["silent_stalls"] += 1
            self.notes.append(f"silent since {self._whole_s:.2f} s")

    def note_end_of_faults(self) -> None:
        """Count what was wrong up to now as a bad frame: spikes are frames all the same."""
        self._is_spiked = True
        self.last_bad = self._clock.now(), self._t_s

    def recovery(self, healed_s: float, limit_s: float = OUTAGE_S) -> tuple[float, float, str]:
        """Say how it came back from the last fault; `healed_s` is when all of them ended.

        That is, stream time from the last bad frame to a whole decision, time from the end of all
        faults to the last bad frame, and what took too long; empty if nothing did.
        """
        if self.last_bad is None:
            return 0.0, 0.0, "" if self.wholes else "no decision at all"
        bad_s, bad_t_s = self.last_bad
        outage_s = max(0.0, bad_s - healed_s)
        after = [t_s for now_s, t_s in self.wholes if now_s > bad_s]
        if not after:
            return 0.0, outage_s, "no decision after the last fault"
        stream_s, why = after[0] - bad_t_s, []
        if stream_s > (SPIKED_S if self._is_spiked else RECOVERY_S):
            why.append(f"{stream_s:.2f} s to a decision")
        if outage_s > limit_s:
            why.append(f"{outage_s:.2f} s to good frames")
        return stream_s, outage_s, "; ".join(why)


def _stitched(rows: list[float | None], rate_hz: float) -> str:
    """Return why the frames of a window do not follow each other as they should."""
    gaps = [len(list(gap)) for is_lost, gap in groupby(s is None for s in rows) if is_lost]
    longest = max(gaps, default=0)
    if sum(gaps) > MAX_LOST * len(rows) or longest > MAX_GAP_S * rate_hz + 1e-6:
        return f"{sum(gaps)} frames missing in it"
    known = [(k, s) for k, s in enumerate(rows) if s is not None and not math.isnan(s)]
    if not known:
        return "no frame in it can be told"
    first, first_s = known[0]
    off = max(abs((made_s - first_s) * rate_hz - (k - first)) for k, made_s in known)
    return f"time jumps by {off:.1f} frames in it" if off > 0.5 else ""


class Run:
    """Drive one radar until its clock raises what ends it.

    The worker, its panel, tamper watch and health are the daemon's own, but one thread does the
    work of reader and worker, so that a virtual clock can hold it.
    """

    def __init__(
        self,
        connect: Callable[[], Transport],
        clock: Any,
        *,
        seed: int,
        rate_hz: float = 60.0,
        classifier: Classifier | None = None,
    ) -> None:
        settings = RadarSettings.for_frame_rate(rate_hz)
        name = f"module {seed}"  # its pauses follow from it
        self.radar = ReconnectingRadar(
            # The driver's own deadlines, also within tests, which are patient.
            X2Radar(connect, settings, deadlines=Deadlines(), name=name, run_id="campaign"),
            wait=True,
            clock=clock.now,
            sleep=clock.sleep,
        )
        self._clock = clock
        self._lock = threading.Lock()
        self._gate = "invalid"
        self._health = Health(clock=clock.now)
        self._heard_s = clock.now()
        stream = StreamInfo(settings.axis, rate_hz, "module", "campaign")
        config = load_config(environ={}, options={"sensor": {"port": "sim:human"}})
        pipeline = Pipeline(stream, config, classifier)
        self.watcher = Watcher(pipeline.shape.n_slow, rate_hz, clock)
        parts = make_parts(config, pipeline, now=wall_clock, is_live=False)
        store, rate = StateStore(EventLog(None), None), RateWatch(rate_hz)
        self._worker = Worker(parts, self._hear, self._health, store, rate=rate)
        self._ring = self._worker.ring

    def go(self) -> None:
        """Run; the end is an error from the clock, or that of the radar when it is closed."""
        for item in self.radar.items():
            with self._lock:
                if isinstance(item, Frame):
                    self.watcher.frame(item)
                    for each in self._ring.items(item):
                        self._take(each)
                elif item.kind in {"lost", "found"}:
                    self._ring.post(item.kind, item.reason)
                    with contextlib.suppress(TimeoutError):
                        while (each := self._ring.next_item(0)) is not None:
                            self._take(each)

    def tick(self) -> None:
        """Do what a worker does that waits in vain; to be called twice a second."""
        with self._lock:
            if self._clock.now() - self._heard_s >= _LOOK_UP_S:
                self._worker.look_up()
            is_announced = (
                self._health.status.state != "online"
                or "fault" in self._worker.tracker.open_events
            )
            self.watcher.look(is_announced=is_announced)

    def _take(self, item: Dwell | Notice) -> None:
        self._heard_s = self._clock.now()
        self._worker.handle(item)
        if isinstance(item, Dwell):
            self.watcher.decision(item, is_whole=self._gate != "invalid")

    def _hear(self, record: Record) -> None:
        if record["type"] == "decision":
            self._gate = record["gate"]
