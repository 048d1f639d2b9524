"""RoomCalibration: calibrate while the daemon runs, of the dwells that decisions are made of.

First there is time to leave the room, then it is listened to, then the file is written and the
gate takes it up.
"""

import logging

from radard.alarm.sensor_state import CalibrationProgress
from radard.config.config import Config
from radard.config.credentials import redact
from radard.config.directories import kept_calibration
from radard.detect.calibration import Calibration, Provenance
from radard.errors import RadardError
from radard.judge.classifier import Classifier
from radard.pipeline import Pipeline
from radard.stream.ring import Dwell
from x2radar import wall_clock
from x2radar.command import installed_version
from x2radar.errors import WriteError
from x2radar.frame import StreamInfo

log = logging.getLogger("radard")


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
    """One calibration, asked for at `t_s`; an error in it ends nothing else."""

    def __init__(self, config: Config, pipeline: Pipeline, t_s: float) -> None:
        # Late: nobody else in the daemon needs scipy.
        from radard.detect.survey import RoomSurvey  # noqa: PLC0415

        self._survey = RoomSurvey(config.gate, config.decision.hop_s)
        self._path = kept_calibration(config)
        self._made_by = pipeline.stream, pipeline.classifier, config.sensor.port or ""
        self._from_s = t_s + config.gate.calibrate_after_s
        self._to_s = self._from_s + config.gate.calibrate_s
        # How far it is; any thread may read it.
        self.progress = CalibrationProgress("leave", round(config.gate.calibrate_after_s))

    def take(self, dwell: Dwell) -> Calibration | None:
        """Take a dwell, one after the other; return the calibration, kept, with the last one."""
        if self.progress.is_over:
            return None
        began_s = dwell.t_s - len(dwell.frames) / dwell.frame_rate_hz
        is_early = began_s < self._from_s
        phase, end_s = ("leave", self._from_s) if is_early else ("listen", self._to_s)
        self.progress = CalibrationProgress(phase, max(0, round(end_s - dwell.t_s)))
        if phase == "leave":
            return None
        try:
            self._survey.add(dwell)
            return self._finish() if dwell.t_s >= self._to_s else None
        except RadardError as err:
            self.stop(str(err))
        except Exception as err:
            log.exception("the calibration broke off")
            self.stop(repr(err))
        return None

    def stop(self, reason: str) -> None:
        """End it without a result; does nothing once it has ended."""
        if not self.progress.is_over:
            self.progress = CalibrationProgress("failed", text=reason)
            log.warning("calibration: %s; what held before holds", reason)

    def _finish(self) -> Calibration:
        self._survey.check_empty()
        made = self._survey.calibration(origin_of(*self._made_by))
        rate = made.provenance.false_gates_per_day
        text = f"predicted false gates: {rate:.2g} a day, in such a room"
        try:
            made.save(self._path)
        except WriteError as err:
            text += f"; holds until the end of this run: {err}"
            log.warning("calibration: %s", text)
        self.progress = CalibrationProgress("made", text=f"{made.provenance.made_utc}, {text}")
        log.info("calibration: %s: %s", self._path, text)
        return made
