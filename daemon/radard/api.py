"""Features and classification of frames in an array, for scripts and notebooks.

`radard.classify`, `radard.features` and `radard.spectrogram` are these functions. They take the
daemon's own way through the same code, window by window, so that what a script sees is what an
alarm would have seen. Frames come from `x2radar.simulate`, `x2radar.read_frames`, or elsewhere.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from radard.config.config import Config
from radard.config.sections import ModelSection
from radard.detect.clutter_map import ClutterRemover
from radard.dsp.doppler import micro_doppler, velocity_mps
from radard.dsp.downconvert import DownConverter
from radard.dsp.velocity import CPI_S
from radard.errors import UsageError
from radard.judge.bundle import load_bundle
from radard.judge.decision import Decision
from radard.judge.evidence import HOP_S
from radard.judge.features import FeatureSettings, FeatureStream
from radard.judge.model_choice import model_for
from radard.pipeline import Pipeline
from radard.run.components import make_classifier
from radard.stream.ring import FrameRing
from x2radar.frame import FastTimeAxis, Frame, StreamInfo

Frames = NDArray[np.complex64] | NDArray[np.float32]
_SETTINGS = FeatureSettings(n_cpi=0, range_decimation=8)
"""Of features without a bundle: those of the thesis, with bins of 3 cm of an X2, as bundles."""


@dataclass(frozen=True, slots=True, eq=False)
class FeatureWindow:
    """The features of one window."""

    t_s: float  # when it ends, in seconds since the first frame
    inputs: Mapping[str, NDArray[np.float32]]  # those that were asked for, by name


@dataclass(frozen=True, slots=True, eq=False)
class Spectrogram:
    """The thesis' micro-Doppler spectrogram."""

    power: NDArray[np.float32]  # mu, (n_doppler, n_columns), linear, in sample units squared
    velocity_mps: NDArray[np.float64]  # of rows; approaching is positive, aliases are c fp/2f away
    t_s: NDArray[np.float64]  # middles of the columns' CPIs, since the first frame


def classify(
    frames: Frames, axis: FastTimeAxis, frame_rate_hz: float, *, model: str = "auto"
) -> list[Decision]:
    """Judge frames as the alarm does: every second, on the last two.

    Parameters
    ----------
    frames : ndarray, shape (n, n_range), complex64 (baseband) or float32 (RF)
        In order, one a frame period, in any unit. A row that is not finite counts as lost.
    axis : FastTimeAxis
        Axis of the frames.
    frame_rate_hz : float
        Frames per second.
    model : str
        Name of an installed bundle, path of an .onnx file, ``none`` for the gate alone, or
        ``auto`` for the one that suits the module.

    Returns
    -------
    list of Decision
        One for every whole window; the first ends 2.45 s behind the first frame.

    Raises
    ------
    RadardError
        UsageError if frames and axis do not fit, ModelMismatch if the model does not fit them,
        BundleError if there is no such model.

    Examples
    --------
    >>> import radard, x2radar
    >>> frames, stream = x2radar.simulate("human", duration_s=3.5, seed=1)
    >>> decisions = radard.classify(frames, stream.axis, stream.frame_rate_hz)
    >>> [(d.gate, d.label, d.alarm) for d in decisions]
    [('open', 'human', True), ('open', 'human', True)]
    >>> decisions[0].window.human > 0.9
    True
    """
    frames = _checked(frames, axis, frame_rate_hz)
    stream = StreamInfo(axis, frame_rate_hz, "array")
    config = Config(model=ModelSection(name=model))
    pipeline = Pipeline(stream, config, make_classifier(config, stream))
    dwells = pipeline.make_ring().dwells(_numbered(frames, axis))
    return [pipeline.decide(dwell) for dwell in dwells]


def features(
    frames: Frames,
    axis: FastTimeAxis,
    frame_rate_hz: float,
    *,
    model: str | None = None,
    names: Sequence[str] = ("velocity_time", "range_time"),
    settings: FeatureSettings | None = None,
) -> list[FeatureWindow]:
    """Return the features of every window: what networks see.

    Parameters
    ----------
    frames, axis, frame_rate_hz
        As for `classify`.
    model : str, optional
        Make the inputs of this bundle, with its settings; `names` and `settings` are not used.
    names : sequence of str
        Features; `radard.FEATURES` lists them.
    settings : FeatureSettings, optional
        How they are made; with `n_cpi` 0 a CPI of the thesis' length at any frame rate.

    Returns
    -------
    list of FeatureWindow
        One for every whole window, a second apart: 2 s of spectrogram columns, made of 2.45 s of
        frames at 60 Hz. Windows with too many lost frames are left out.

    Raises
    ------
    RadardError
        As `classify`; ModelMismatch also if there is no such feature.

    Examples
    --------
    >>> import radard, x2radar
    >>> frames, stream = x2radar.simulate("dog", duration_s=2.5, seed=1)
    >>> window, = radard.features(frames, stream.axis, stream.frame_rate_hz)
    >>> window.t_s, {name: x.shape for name, x in window.inputs.items()}
    (2.45, {'velocity_time': (101, 40), 'range_time': (40, 40)})
    """
    frames = _checked(frames, axis, frame_rate_hz)
    if model is not None:
        bundle = load_bundle(model_for(model, StreamInfo(axis, frame_rate_hz, "array")))
        bundle.check_stream(axis, frame_rate_hz)
        settings, names = bundle.features, [each.feature for each in bundle.inputs]
    settings = (settings or _SETTINGS).at(frame_rate_hz)
    converter = DownConverter(axis, settings.range_step(axis))
    shape = settings.dwell_shape(HOP_S, frame_rate_hz)
    ring = FrameRing(converter.axis, converter.convert, shape)
    remover, maker = ClutterRemover(), FeatureStream(settings, tuple(names))
    windows = []
    for dwell in ring.dwells(_numbered(frames, axis)):
        moving = remover.remove(dwell) if settings.clutter == "removed" else dwell
        if moving.is_whole:
            windows.append(FeatureWindow(dwell.t_s, maker.extract(moving)))
    return windows


def spectrogram(
    frames: Frames, axis: FastTimeAxis, frame_rate_hz: float, *, cpi_s: float = CPI_S
) -> Spectrogram:
    """Return the thesis' micro-Doppler spectrogram of frames, a column a frame.

    Parameters
    ----------
    frames, axis, frame_rate_hz
        As for `classify`; a row that is not finite repeats the one before it.
    cpi_s : float
        Length of a coherent processing interval, in seconds; the thesis' 28 frames at 60 a
        second by default.

    Returns
    -------
    Spectrogram
        With velocities from the carrier: `FastTimeAxis.carrier_hz` must be known.

    Raises
    ------
    RadardError
        If frames and axis do not fit, or the frames are fewer than those of a CPI.

    Examples
    --------
    >>> import radard, x2radar
    >>> frames, stream = x2radar.simulate("thesis_dog", duration_s=3, seed=1)
    >>> mu = radard.spectrogram(frames, stream.axis, stream.frame_rate_hz)
    >>> mu.power.shape, mu.velocity_mps.shape, mu.t_s.shape
    ((28, 153), (28,), (153,))
    >>> round(float(mu.velocity_mps[0]), 2), float(mu.velocity_mps[14])
    (-0.66, 0.0)
    """
    frames = _checked(frames, axis, frame_rate_hz)
    if not axis.carrier_hz > 0:
        raise UsageError("the axis has no carrier_hz, so there are no velocities")
    n_cpi = max(2, round(cpi_s * frame_rate_hz))
    rows = DownConverter(axis).convert(frames)
    power = micro_doppler(rows, n_cpi)
    t_s = (np.arange(power.shape[1], dtype=np.float64) + n_cpi / 2) / frame_rate_hz
    return Spectrogram(power, velocity_mps(n_cpi, frame_rate_hz, axis.carrier_hz), t_s)


def _checked(frames: Any, axis: FastTimeAxis, frame_rate_hz: float) -> Frames:
    rows = np.asarray(frames)
    if rows.ndim != 2 or rows.shape[1] != axis.n_range:
        raise UsageError(f"frames of the shape {rows.shape}: the axis wants (n, {axis.n_range})")
    dtype, wanted = (np.complex64, "c") if axis.kind == "baseband" else (np.float32, "fiu")
    if rows.dtype.kind not in wanted:
        numbers = "complex" if wanted == "c" else "real"
        raise UsageError(f"frames of {rows.dtype}: {axis.kind} frames are {numbers}")
    if not 0 < frame_rate_hz < np.inf:
        raise UsageError(f"frame_rate_hz {frame_rate_hz}: must be above 0")
    return cast("Frames", np.ascontiguousarray(rows, dtype))


def _numbered(frames: Frames, axis: FastTimeAxis) -> Iterator[Frame]:
    last = -1
    for k in np.flatnonzero(np.isfinite(frames).all(axis=1)).tolist():
        yield Frame(frames[k], k, k, k - last - 1, False, axis)
        last = k
