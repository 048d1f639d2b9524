"""Pipeline: the way of a dwell to a decision. Read this file first.

A frame's way through the program::

    x2radar.transport   bytes from the port
    x2radar.framing     bytes -> packets
    x2radar.codec       packets -> messages
    x2radar.assemble    messages -> Frame (numbered, losses stated)
    radard.dsp.downconvert   RF -> baseband, matched filter        [reader thread]
    radard.ring         frames -> Dwell, 2 s of them every 1 s      [reader | worker]
    radard.clutter_map  takes out what stands still, with its jitter [worker]
    radard.gate         does anything move?
    radard.tracks       where, and how many?
    radard.features     Dwell -> spectrogram, cadence, vectors
    radard.classifier   features -> probabilities
    radard.decision     probabilities -> label, alarm
    radard.events       decisions -> events with a beginning and an end
    radard.sinks        everything -> JSON Lines, table

`Pipeline.decide` is all of the worker's part that computes, without threads or clocks, so
live, replayed and offline data take the same way.
"""

from dataclasses import replace

import numpy as np

from radard.classifier import Classifier, Probabilities
from radard.clutter_map import ClutterRemover
from radard.config import Config
from radard.decision import Decision, Label, TrackVerdict, judge
from radard.dsp.downconvert import DownConverter
from radard.dsp.range_gate import range_gates
from radard.errors import FeatureError, ModelMismatch
from radard.features import FeatureSettings, FeatureStream, extract
from radard.gate import Gate, GateSettings
from radard.ring import Dwell, DwellShape, FrameRing
from radard.tracks import Track, Tracker
from x2radar.frame import StreamInfo

HOP_S = 1.0
COARSE_BIN_M = 0.03
"""Behind the matched filter an X2's bins may be that long without loss (41 GS/s, 8 of them)."""


class Pipeline:
    """Everything between the frames of one stream and its decisions.

    Parameters
    ----------
    stream : StreamInfo
        Axis and rate of the frames.
    config : Config
        Gate and decision settings.
    classifier : Classifier, optional
        Without one, only the gate works.

    Raises
    ------
    ModelMismatch
        If the classifier was not made for such a stream.
    FeatureError
        If the stream's frames cannot be processed.
    """

    def __init__(
        self, stream: StreamInfo, config: Config, classifier: Classifier | None = None
    ) -> None:
        self.stream = stream
        self.classifier = classifier
        if classifier is not None:
            classifier.bundle.check_stream(stream.axis, stream.frame_rate_hz)
            self._features = classifier.bundle.features
            self.pet_limit = config.decision.pet_limit or classifier.bundle.pet_limit
        else:
            self._features = _gate_only_features(stream)
            self.pet_limit = config.decision.pet_limit or 0.8
        names = classifier.feature_names if classifier else ()
        self._stream = FeatureStream(self._features, names)
        self._feature_names = names
        self.policy = config.decision.policy or "window"
        self.shape = DwellShape.of(
            dwell_s=self._features.dwell_s,
            hop_s=HOP_S,
            frame_rate_hz=stream.frame_rate_hz,
            n_cpi=self._features.n_cpi,
        )
        g = config.gate
        self._gate = Gate(
            GateSettings(
                threshold_db=g.threshold_db,
                adapt_db=g.adapt_db,
                memory_s=g.memory_s,
                learn_s=g.learn_s,
                in_place_m=g.in_place_m,
            ),
            HOP_S,
        )
        self._remover = ClutterRemover()
        self._tracker = Tracker()
        self._seq = 0

    def make_ring(self) -> FrameRing:
        """Return the ring that takes this stream's frames and gives this pipeline's dwells."""
        converter = DownConverter(self.stream.axis, self._features.range_decimation)
        return FrameRing(converter.axis, converter.convert, self.shape)

    def restart(self) -> None:
        """Forget what was learned of the room: the module began anew."""
        self._gate.reset()
        self._remover.reset()
        self._tracker.reset()
        self._stream = FeatureStream(self._features, self._feature_names)

    def decide(self, dwell: Dwell) -> Decision:
        """Judge one dwell.

        Parameters
        ----------
        dwell : Dwell
            From the ring that `make_ring` made.

        Returns
        -------
        Decision
            Numbered from 1.
        """
        self._seq += 1
        if not dwell.is_whole:
            return self._invalid(dwell, f"{dwell.n_lost} frames missing")
        moving = self._remover.remove(dwell)
        if not moving.is_whole:
            return self._invalid(dwell, f"{moving.n_lost} frames missing or spiked")
        reading = self._gate.read(moving)
        tracks = self._tracker.update(moving, self._gate.background)
        window: Probabilities | None = None
        verdicts: tuple[TrackVerdict, ...] = ()
        label: Label | None = None
        alarm = False
        if not reading.is_open:
            label = "none"
        else:
            try:
                window = self._classified(moving if self._features.clutter == "removed" else dwell)
                verdicts = self._judged(moving, tracks)
            except (ModelMismatch, FeatureError) as err:
                # No verdict is better announced than guessed.
                return self._invalid(dwell, str(err))
            if window is not None:
                label, alarm = judge(window, self.pet_limit)
        return Decision(
            seq=self._seq,
            t_s=dwell.t_s,
            gate="open" if reading.is_open else "closed",
            reading=reading,
            window=window,
            fused=window,
            label=label,
            alarm=alarm,
            frames=len(dwell.frames) - dwell.n_lost,
            dropped=dwell.n_lost,
            tracks=verdicts,
            t_mono_s=dwell.t_mono_s,
        )

    def _classified(self, dwell: Dwell) -> Probabilities | None:
        if self.classifier is None:
            return None
        return self.classifier.classify(self._stream.extract(dwell))

    def _judged(self, moving: Dwell, tracks: tuple[Track, ...]) -> tuple[TrackVerdict, ...]:
        """Judge every body by itself, by what its own range gate lets through."""
        if not tracks:
            return ()
        paths_m = np.stack([track.path_m for track in tracks])
        gates = range_gates(paths_m, moving.axis.range_m) if self.classifier else None
        verdicts = []
        for k, track in enumerate(tracks):
            window: Probabilities | None = None
            if self.classifier is not None and gates is not None:
                alone = replace(moving, frames=moving.frames * gates[k])
                features = extract(alone, self._features, self._feature_names)
                window = self.classifier.classify(features)
            verdicts.append(
                TrackVerdict(
                    id=track.id,
                    range_m=track.range_m,
                    radial_velocity_mps=track.radial_velocity_mps,
                    window=window,
                )
            )
        return tuple(verdicts)

    def _invalid(self, dwell: Dwell, fault: str) -> Decision:
        return Decision(
            seq=self._seq,
            t_s=dwell.t_s,
            gate="invalid",
            reading=None,
            window=None,
            fused=None,
            label="invalid",
            alarm=False,
            frames=len(dwell.frames) - dwell.n_lost,
            dropped=dwell.n_lost,
            fault=fault,
            t_mono_s=dwell.t_mono_s,
        )


def _gate_only_features(stream: StreamInfo) -> FeatureSettings:
    """Return settings whose CPI is as long as the seed's, and bins as coarse as may be."""
    bins = int(COARSE_BIN_M / stream.axis.bin_length_m)
    return FeatureSettings(
        n_cpi=max(2, round(28 / 60 * stream.frame_rate_hz)), range_decimation=max(1, bins)
    )
