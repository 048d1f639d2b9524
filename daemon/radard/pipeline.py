"""Pipeline: the way of a dwell to a decision. Read this file first.

A frame's way through the program::

    x2radar.transport   bytes from the port
    x2radar.framing     bytes -> packets
    x2radar.codec       packets -> messages
    x2radar.assemble    messages -> Frame (numbered, losses stated)
    radard.dsp.downconvert   RF -> baseband, matched filter        [reader thread]
    radard.ring         frames -> Dwell, 2 s of them every 1 s      [reader | worker]
    radard.gate         does anything move?                         [worker]
    radard.features     Dwell -> spectrogram, cadence, vectors
    radard.classifier   features -> probabilities
    radard.decision     probabilities -> label, alarm
    radard.events       decisions -> events with a beginning and an end
    radard.sinks        everything -> JSON Lines, table

`Pipeline.decide` is all of the worker's part that computes, without threads or clocks, so
live, replayed and offline data take the same way.
"""

from radard.classifier import Classifier, Probabilities
from radard.config import Config
from radard.decision import Decision, Label, judge
from radard.dsp.downconvert import DownConverter
from radard.errors import FeatureError, ModelMismatch
from radard.features import FeatureSettings, extract
from radard.gate import Gate, GateSettings
from radard.ring import Dwell, DwellShape, FrameRing
from x2radar.frame import StreamInfo

HOP_S = 1.0


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
            self._features = _gate_only_features(stream.frame_rate_hz)
            self.pet_limit = config.decision.pet_limit or 0.8
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
        self._seq = 0

    def make_ring(self) -> FrameRing:
        """Return the ring that takes this stream's frames and gives this pipeline's dwells."""
        converter = DownConverter(self.stream.axis, self._features.range_decimation)
        return FrameRing(converter.axis, converter.convert, self.shape)

    def restart(self) -> None:
        """Forget what was learned of the room: the module began anew."""
        self._gate.reset()

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
        reading = self._gate.read(dwell)
        window: Probabilities | None = None
        label: Label | None = None
        alarm = False
        if not reading.is_open:
            label = "none"
        elif self.classifier is not None:
            names = self.classifier.feature_names
            try:
                window = self.classifier.classify(extract(dwell, self._features, names))
            except (ModelMismatch, FeatureError) as err:
                # No verdict is better announced than guessed.
                return self._invalid(dwell, str(err))
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
            t_mono_s=dwell.t_mono_s,
        )

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


def _gate_only_features(frame_rate_hz: float) -> FeatureSettings:
    """Return settings whose CPI is as long as the seed's, 28 frames at 60 Hz."""
    return FeatureSettings(n_cpi=max(2, round(28 / 60 * frame_rate_hz)))
