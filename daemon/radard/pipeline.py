"""Pipeline: the way of a dwell to a decision. Read this file first.

A frame's way through the program (docs/research/follow-a-frame.md tells it)::

    x2radar.device.transport   bytes from the port
    x2radar.wire.framing       bytes -> packets
    x2radar.wire.codec         packets -> messages
    x2radar.device.assemble    messages -> Frame (numbered, losses stated)
    radard.dsp.downconvert     RF -> baseband, matched filter             [reader thread]
    radard.stream.ring         frames -> Dwell, 2.45 s of them every hop  [reader | worker]
    radard.detect.clutter_map  takes out what stands still, with its jitter     [worker]
    radard.detect.gate         does anything move?
    radard.detect.tracks       where, and how many?
    radard.judge.features      Dwell -> maps of range and velocity over time
    radard.judge.classifier    features -> probabilities
    radard.judge.evidence      probabilities over windows -> what is known by now
    radard.judge.decision      probabilities -> label, alarm
    radard.detect.tamper       is the sensor covered, moved, jammed or dead?
    radard.alarm.events        decisions -> events with a beginning and an end
    radard.outputs             everything -> JSON Lines, table

`Pipeline.decide` is all of the worker's part that computes, without threads, clocks or files, so
live, replayed and offline data take the same way.
"""

from dataclasses import replace

import numpy as np

from radard.config.config import Config
from radard.detect.calibration import Calibration
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import Gate
from radard.detect.tamper import Finding, TamperWatch, is_frozen
from radard.detect.tracks import Track, Tracker, range_gates
from radard.dsp.downconvert import DownConverter
from radard.errors import ModelMismatch
from radard.judge.bundle import EvidenceSettings
from radard.judge.classifier import Answer, Classifier, Seen
from radard.judge.decision import (
    Decision,
    Label,
    TrackVerdict,
    Verdict,
    invalid_decision,
    pet_limit_of,
    policy_of,
)
from radard.judge.evidence import Evidence
from radard.judge.features import FeatureSettings, FeatureStream, extract
from radard.judge.installation import echo_at_1m_db, installation
from radard.stream.ring import Dwell, FrameRing
from x2radar.frame import StreamInfo


class Pipeline:
    """Everything between the frames of one stream and its decisions.

    Without a `classifier` only the gate works. `judges_tracks`: every body is judged by itself as
    well, for zones and people to look at; no verdict depends on it. What looks for `tamper` is put
    there by others. Raises ModelMismatch if the classifier was not made for such a stream, or
    FeatureError if its frames cannot be processed.
    """

    tamper: TamperWatch | None = None
    seen: Seen | None = None  # what the network was given of the last dwell, and its answer

    def __init__(
        self,
        stream: StreamInfo,
        config: Config,
        classifier: Classifier | None = None,
        *,
        judges_tracks: bool = True,
    ) -> None:
        self.stream, self.classifier = stream, classifier
        self._config, self._judges_tracks = config, judges_tracks
        bundle = classifier.bundle if classifier else None
        if bundle is not None:
            bundle.check_stream(stream.axis, stream.frame_rate_hz)
        # The gate alone has bins as coarse as may be.
        alone = FeatureSettings(n_cpi=0, range_decimation=stream.axis.n_range)
        self._features = (bundle.features if bundle else alone).at(stream.frame_rate_hz)
        # Made with it, so that frames that cannot be processed are refused at once.
        self._converter = DownConverter(stream.axis, self._features.range_step(stream.axis))
        self._feature_names = classifier.feature_names if classifier else ()
        self._stream = FeatureStream(self._features, self._feature_names)
        self.policy = policy_of(config, bundle)
        evidence = EvidenceSettings.from_mapping(bundle.evidence if bundle else {})
        # No more often than frames come.
        hop_s = max(config.decision.hop_s, 1 / stream.frame_rate_hz)
        self._evidence = Evidence(evidence, hop_s)
        waits = (evidence, config.decision.decide_within_s) if self.policy == "fused" else ()
        # Another `pet_limit` of it holds from the next dwell on.
        self.verdict = Verdict(pet_limit_of(config, bundle), *waits)
        self.shape = self._features.dwell_shape(hop_s, stream.frame_rate_hz)
        self.gate = Gate(config.gate, hop_s)  # the gate, with what it saw of the last dwell
        self.calibration: Calibration | None = None
        self._remover = ClutterRemover()
        self._tracker = Tracker()
        self._seq = 0

    def make_ring(self) -> FrameRing:
        """Return the ring that takes this stream's frames and gives this pipeline's dwells."""
        return FrameRing(self._converter.axis, self._converter.convert, self.shape)

    def use(self, calibration: Calibration | None) -> None:
        """Give the gate its room's calibration, or none; ConfigError if it does not fit."""
        if calibration is not None:
            calibration.check(self._converter.axis, self.stream.frame_rate_hz)
        self.calibration = calibration
        self.gate = Gate(self._config.gate, self.shape.hop_s, calibration)

    def restart(self) -> None:
        """Forget what was learned of the room: the module has restarted."""
        self.use(self.calibration)
        self._remover = ClutterRemover()
        self._tracker.reset()
        self._stream = FeatureStream(self._features, self._feature_names)
        self._evidence.reset()
        self.verdict.reset()

    def decide(self, dwell: Dwell) -> Decision:
        """Judge one dwell from the ring that `make_ring` made; decisions are numbered from 1."""
        self._seq += 1
        self.seen = None
        if not dwell.is_whole:
            return invalid_decision(dwell, f"{dwell.n_lost} frames missing", seq=self._seq)
        moving = self._remover.remove(dwell)
        if not moving.is_whole:
            fault = f"{moving.n_lost} frames missing or spiked"
            return invalid_decision(dwell, fault, seq=self._seq)
        # One gate for all, should a reload put another in its place just now.
        gate = self.gate
        reading = gate.read(moving)
        tracks: tuple[Track, ...] = ()
        is_followed = self._config.decision.bodies != "unfollowed"
        if is_followed and (reading.is_open or self._tracker.is_following):
            tracks = self._tracker.update(moving, gate.background)
        window = fused = None
        verdicts: tuple[TrackVerdict, ...] = ()
        label: Label | None = None
        alarm = False
        if not reading.is_open:
            label, alarm = "none", self.verdict.leave()
            self._evidence.end_visit()
        else:
            try:
                answer = self._ask(moving if self._features.clutter == "removed" else dwell)
                verdicts = self._judge_tracks(moving, tracks, answer)
            except ModelMismatch as err:
                # No verdict is better announced than guessed.
                return invalid_decision(dwell, str(err), seq=self._seq)
            if answer is not None:
                fused = window = answer.window
                if self.policy == "fused":
                    seen = {"t_s": dwell.t_s, "range_m": reading.range_m}
                    fused = self._evidence.fuse(answer, self._strength_db(gate, dwell), **seen)
                label, alarm = self.verdict.judge(fused, dwell.t_s)
        findings: tuple[Finding, ...] = ()
        if self.tamper is not None:
            is_passed_over = label is not None and not alarm
            findings = self.tamper.update(dwell, gate, is_passed_over=is_passed_over)
        return Decision(
            seq=self._seq,
            t_s=dwell.t_s,
            gate="open" if reading.is_open else "closed",
            reading=reading,
            window=window,
            fused=fused,
            label=label,
            alarm=alarm,
            frames=len(dwell.frames) - dwell.n_lost,
            dropped=dwell.n_lost,
            tracks=verdicts,
            undecided_s=self.verdict.undecided_s,
            fault="dead sensor: all frames are the same" if is_frozen(dwell) else "",
            findings=findings,
            t_mono_s=dwell.t_mono_s,
        )

    def _ask(self, dwell: Dwell) -> Answer | None:
        """Return what the network says of a dwell; None without one."""
        if self.classifier is None:
            return None
        # How strong an echo is counts once, in the evidence: networks hardly learned from it.
        mount = self._config.mount
        known = installation(dwell.frame_rate_hz, mount.height_m, mount.tilt_deg)
        features, hidden = self._stream.extract(dwell, known), self._evidence.hidden
        answer = self.classifier.answer(features, hidden)
        self.seen = Seen(features, hidden, answer)
        return answer

    def _strength_db(self, gate: Gate, dwell: Dwell) -> float | None:
        """Return how strong what moves is over an adult; None where that is not known."""
        if (level_db := self._config.mount.level_db) is None:
            return None
        echo_db = echo_at_1m_db(gate.power, gate.noise, dwell.axis.range_m)
        return None if echo_db is None else echo_db - level_db

    def _judge_tracks(
        self, moving: Dwell, tracks: tuple[Track, ...], answer: Answer | None
    ) -> tuple[TrackVerdict, ...]:
        """Judge every body of several by its own range gate, if `decision.bodies` asks."""
        if not tracks or not self._judges_tracks:
            return ()
        windows = [answer.window if answer and len(tracks) == 1 else None] * len(tracks)
        is_apart = len(tracks) > 1 and self._config.decision.bodies == "apart"
        if self.classifier is not None and is_apart:
            paths_m = np.stack([track.path_m for track in tracks])
            for k, gate in enumerate(range_gates(paths_m, moving.axis.range_m)):
                alone = replace(moving, frames=moving.frames * gate)
                features = extract(alone, self._features, self._feature_names)
                windows[k] = self.classifier.answer(features).window
        return tuple(
            TrackVerdict(
                id=track.id,
                range_m=track.range_m,
                radial_velocity_mps=track.radial_velocity_mps,
                window=window,
            )
            for track, window in zip(tracks, windows, strict=True)
        )
