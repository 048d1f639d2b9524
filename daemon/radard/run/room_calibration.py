"""RoomCalibration: calibrate while the daemon runs, of the dwells that decisions are made of.

First there is time to leave the room, then it is listened to, on a thread of its own, then the
file is written and the gate takes it up.
"""

import logging
import queue
import threading
from collections.abc import Callable
from dataclasses import replace

from radard.alarm.sensor_state import CalibrationProgress
from radard.config.config import Config
from radard.config.credentials import redact
from radard.config.directories import kept_calibration
from radard.detect.calibration import Calibration, Provenance
from radard.errors import RadardError
from radard.judge.classifier import Classifier
from radard.stream.ring import Dwell
from x2radar import wall_clock
from x2radar.command import installed_version
from x2radar.errors import WriteError
from x2radar.frame import StreamInfo

log = logging.getLogger("radard")
_MAX_WAITING = 30  # dwells, of a second each: a machine that lags by half a minute is too slow


def can_calibrate(config: Config) -> bool:
    """Return whether a running sensor may make its own calibration."""
    return config.gate.calibration != "none" and config.sensor.kind != "replay"


def origin_of(stream: StreamInfo, classifier: Classifier | None, port: str) -> Provenance:
    """Return what is known of a calibration of a stream that is made now."""
    return Provenance(
        made_utc=wall_clock.utc_text(timespec="seconds"),
        device=stream.device,
        port=redact(port),
        software=installed_version(),
        model=classifier.bundle.name if classifier else "none",
        carrier_hz=stream.axis.carrier_hz,
    )


class RoomCalibration:
    """One calibration, asked for at `t_s`; `on_made` gets it, from another thread, once kept."""

    def __init__(
        self,
        config: Config,
        origin: Callable[[], Provenance],
        t_s: float,
        on_made: Callable[[Calibration], None],
    ) -> None:
        self._config = config
        self._path = kept_calibration(config)
        self._origin = origin
        self._on_made = on_made
        self._from_s = t_s + config.gate.calibrate_after_s
        self._to_s = self._from_s + config.gate.calibrate_s
        self._dwells: queue.SimpleQueue[Dwell | None] = queue.SimpleQueue()
        self._is_closed = False  # whether it takes no more dwells
        self._lock = threading.Lock()
        # How far it is; any thread may read it.
        self.progress = CalibrationProgress("leave", round(config.gate.calibrate_after_s))
        self._thread: threading.Thread | None = None

    def take(self, dwell: Dwell) -> None:
        """Take a dwell of the stream, one after the other; returns at once."""
        if self._is_closed:
            return
        began_s = dwell.t_s - len(dwell.frames) / dwell.frame_rate_hz
        if began_s < self._from_s:
            self._show("leave", self._from_s - dwell.t_s)
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="calibration", daemon=True)
            self._thread.start()
        self._show("listen", self._to_s - dwell.t_s)
        if self._dwells.qsize() >= _MAX_WAITING:
            self.stop("the machine is too slow for it")
            return
        # A dwell is a view into the ring, which goes on.
        self._dwells.put(replace(dwell, frames=dwell.frames.copy()))
        if dwell.t_s >= self._to_s:
            self._close()

    def stop(self, reason: str) -> None:
        """End it without a result; does nothing once the room was heard."""
        if not self._is_closed:
            self._fail(reason)

    def _run(self) -> None:
        try:
            self._survey()
        except RadardError as err:
            self._fail(str(err))
        except Exception as err:
            log.exception("the calibration broke off")
            self._fail(repr(err))

    def _survey(self) -> None:
        # Late: nobody else in the daemon needs scipy.
        from radard.detect.survey import RoomSurvey  # noqa: PLC0415

        survey = RoomSurvey(self._config.gate, self._config.decision.hop_s)
        while (dwell := self._dwells.get()) is not None:
            survey.add(dwell)
        if self.progress.is_over:
            return
        survey.check_empty()
        made = survey.calibration(self._origin())
        rate = made.provenance.false_gates_per_day
        text = f"predicted false gates: {rate:.2g} a day, in such a room"
        try:
            made.save(self._path)
        except WriteError as err:
            text += f"; holds until the end of this run: {err}"
            log.warning("calibration: %s", text)
        self._on_made(made)
        self._show("made", text=f"{made.provenance.made_utc}, {text}")
        log.info("calibration: %s: %s", self._path, text)

    def _close(self) -> None:
        self._is_closed = True
        self._dwells.put(None)

    def _fail(self, reason: str) -> None:
        # Said before it is closed: the thread, which may be first, makes nothing of it then.
        is_news = self._show("failed", text=reason)
        self._close()
        if is_news:
            log.warning("calibration: %s; what held before holds", reason)

    def _show(self, phase: str, left_s: float = 0.0, text: str = "") -> bool:
        """Say how far it is; its end is the last word."""
        with self._lock:
            is_open = not self.progress.is_over
            if is_open:
                self.progress = CalibrationProgress(phase, max(0, round(left_s)), text)
        return is_open
