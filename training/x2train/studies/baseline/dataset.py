"""Windows of the thesis' bodies, with features made by the daemon's own code.

An element is one dwell as the live path would see it: RF echoes at 41 GS/s, receiver noise
and quantisation, down-conversion, matched filter, features. It begins anywhere in a
passage, also shortly before the body appears. Every element draws from its own generator,
seeded with (seed, element), so any number of workers gives the same set.
"""

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from radard.classify.features import FeatureSettings, extract
from radard.dsp.downconvert import DownConverter
from radard.stream.ring import Dwell, DwellShape
from x2radar.frame import FastTimeAxis
from x2radar.settings.x2 import RadarSettings
from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES, draw, ranges
from x2radar.sim.signal.pulse import LinkBudget, rf_echo
from x2radar.sim.signal.receiver import Receiver

CLASSES = ("pet", "human")
PASSAGE_S = 5.0
EARLIEST_S = -1.2
LEAST_IN_VIEW = 0.25
_MOST_DRAWS = 1000
_BODIES = (("thesis_human", 1), ("thesis_dog", 0), ("thesis_human", 1), ("thesis_cat", 0))


@dataclass(frozen=True, slots=True, kw_only=True)
class ThesisSetSpec:
    """What a set of the thesis' windows is drawn from.

    Attributes
    ----------
    n_elements : int
        Windows; half people, a quarter dogs, a quarter cats.
    seed : int
        Every draw follows from it.
    frame_rate_hz : float
        Frames per second.
    feature : str
        'thesis_type1' or 'thesis_type2'.
    settings : FeatureSettings
        How the feature is made.
    """

    n_elements: int
    seed: int
    frame_rate_hz: float = 60.0
    feature: str = "thesis_type2"
    settings: FeatureSettings = field(default_factory=FeatureSettings)


@dataclass(frozen=True, slots=True, eq=False)
class LabelledSet:
    """Features and labels.

    Attributes
    ----------
    x : ndarray, shape (n, n_feature), float32
        One feature vector an element.
    y : ndarray, shape (n,), int64
        Row of `CLASSES`.
    body : tuple of str
        Which body it was.
    """

    x: NDArray[np.float32]
    y: NDArray[np.int64]
    body: tuple[str, ...]


def generate(spec: ThesisSetSpec, *, workers: int = 1) -> Iterator[int | LabelledSet]:
    """Make a set; yield how many elements are done, and at last the set.

    Parameters
    ----------
    spec : ThesisSetSpec
        What to draw.
    workers : int
        Processes; the result does not depend on it.

    Yields
    ------
    int or LabelledSet
        Progress, then the result.
    """
    chunk = 64
    jobs = [
        (spec, first, min(first + chunk, spec.n_elements))
        for first in range(0, spec.n_elements, chunk)
    ]
    parts = []
    done = 0
    if workers == 1:
        results: Iterator[NDArray[np.float32]] = map(_elements, jobs)
        for part in results:
            parts.append(part)
            done += len(part)
            yield done
    else:
        with ProcessPoolExecutor(workers) as pool:
            for part in pool.map(_elements, jobs):
                parts.append(part)
                done += len(part)
                yield done
    rows = [_BODIES[k % len(_BODIES)] for k in range(spec.n_elements)]
    yield LabelledSet(
        np.concatenate(parts),
        np.array([label for _, label in rows], np.int64),
        tuple(name for name, _ in rows),
    )


def element(spec: ThesisSetSpec, number: int) -> Dwell:
    """Return the dwell of one element.

    Parameters
    ----------
    spec : ThesisSetSpec
        What to draw.
    number : int
        Which element.

    Returns
    -------
    Dwell
        Baseband with noise; the body's torso is in view for at least a quarter of it.
    """
    stage = _stage(spec.frame_rate_hz, spec.settings)
    rng = np.random.default_rng([spec.seed, number])
    name, _ = _BODIES[number % len(_BODIES)]
    budget = LinkBudget()
    low_m, high_m = stage.axis.range_m[0], stage.axis.range_m[-1]
    n_slow = stage.shape.n_slow
    for _ in range(_MOST_DRAWS):
        body = draw(THESIS_BODIES[name], rng)
        latest_s = PASSAGE_S - LEAST_IN_VIEW * n_slow / spec.frame_rate_hz
        t_s = rng.uniform(EARLIEST_S, latest_s) + np.arange(n_slow) / spec.frame_rate_hz
        range_m, rcs_m2 = ranges(body, t_s)
        present = (t_s >= 0) & (t_s < PASSAGE_S)
        in_view = present & (range_m[:, 0] > low_m) & (range_m[:, 0] < high_m)
        if in_view.mean() >= LEAST_IN_VIEW:
            break
    else:
        msg = f"element {number}: no draw came into view"
        raise RuntimeError(msg)
    amplitude = budget.amplitude(range_m, rcs_m2, stage.axis) * present[:, None]
    receiver = Receiver(stage.radar, stage.axis, budget, rng)
    raw = receiver.rf(rf_echo(range_m, amplitude, stage.axis))
    frames = stage.converter.convert(raw)
    return Dwell(
        frames,
        np.ones(n_slow, np.bool_),
        stage.converter.axis,
        spec.frame_rate_hz,
        n_slow / spec.frame_rate_hz,
    )


@dataclass(frozen=True, slots=True)
class _Stage:
    radar: RadarSettings
    axis: FastTimeAxis
    converter: DownConverter
    shape: DwellShape


@lru_cache(maxsize=4)
def _stage(frame_rate_hz: float, settings: FeatureSettings) -> _Stage:
    radar = RadarSettings.for_frame_rate(frame_rate_hz)
    axis = FastTimeAxis(
        kind="rf",
        n_range=radar.n_range,
        bin_length_m=radar.bin_length_m,
        range_offset_m=radar.range_offset_m,
        carrier_hz=radar.carrier_hz,
        bandwidth_hz=radar.bandwidth_hz,
        sample_rate_hz=radar.sample_rate_hz,
    )
    shape = DwellShape.of(
        dwell_s=settings.dwell_s, hop_s=1.0, frame_rate_hz=frame_rate_hz, n_cpi=settings.n_cpi
    )
    return _Stage(radar, axis, DownConverter(axis, settings.range_decimation), shape)


def _elements(job: tuple[ThesisSetSpec, int, int]) -> NDArray[np.float32]:
    spec, first, last = job
    return np.stack(
        [
            extract(element(spec, k), spec.settings, (spec.feature,)).inputs[spec.feature]
            for k in range(first, last)
        ]
    )
