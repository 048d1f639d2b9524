"""Frames behind the converter, interference on them, and what the daemon makes of that."""

import itertools
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from radard.alarm.events import EventTracker
from radard.alarm.panel import AlarmPanel
from radard.alarm.sensitivity import alarm_policy
from radard.config.config import Config
from radard.config.sections import AlarmSection
from radard.detect.tamper import TamperWatch
from radard.dsp.downconvert import DownConverter
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.features import FeatureSettings
from radard.pipeline import Pipeline
from radard.stream.source import open_source
from tests.radar_helpers import dwell_of

RATE_HZ = 60
ON_S = 30.0
"""When interference begins, in a room that was empty."""
FIRST_S, EVERY_S, VISIT_S = 40, 20, 8


def stream_s(n_walks):
    """How long a stream with so many walk-ins lasts."""
    return FIRST_S + n_walks * EVERY_S


def scene_text(*visits):
    """A scene of an empty room with visits, as YAML: (seconds before, actor, seconds)."""
    lines = ["like: empty", "steps:"]
    for empty_s, actor, seconds in visits:
        lines += [f"  - {{duration_s: {empty_s}}}", f"  - {{{actor}, duration_s: {seconds}}}"]
    return "\n".join(lines) + "\n"


def walk_ins(n_walks):
    """People who walk in, one after the other."""
    ways = itertools.cycle(("approach", "leave", "cross"))
    who = [f"body: human, style: walk, course: {next(ways)}" for _ in range(n_walks)]
    empty_s = [FIRST_S, *[EVERY_S - VISIT_S] * (n_walks - 1)]
    return scene_text(*zip(empty_s, who, [VISIT_S] * n_walks, strict=True))


@cache
def rows_of(text, seconds, seed=4):
    """A scene's frames behind the converter, and its stream: (n, n_range) complex64."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "scene.yaml"
        file.write_text(text)
        source = open_source(f"sim:{file}?seed={seed}", speed="max")
        axis = source.stream.axis
        converter = DownConverter(axis, FeatureSettings(range_decimation=8).range_step(axis))
        rows = np.zeros((seconds * RATE_HZ, converter.axis.n_range), np.complex64)
        for frame in source.frames():
            if frame.index >= len(rows):
                break
            converter.convert(frame.samples[None], rows[frame.index : frame.index + 1])
        source.close()
    rows.flags.writeable = False
    return rows, source.stream, converter.axis


class Jammer:
    """Interference on frames from `ON_S` on; levels are dB over the receiver's noise."""

    def __init__(self, rows, axis):
        self.rows, self.axis = rows, axis
        self.t_s = np.arange(len(rows)) / RATE_HZ
        self.is_on = (self.t_s >= ON_S)[:, None]
        quiet = rows[10 * RATE_HZ : 30 * RATE_HZ]
        self.noise = float((np.abs(np.diff(quiet, axis=0)) ** 2).mean() / 2)
        self.rng = np.random.default_rng(7)

    def level(self, db):
        return np.sqrt(self.noise * 10 ** (db / 10))

    def white(self, db):
        parts = self.rng.standard_normal((*self.rows.shape, 2), np.float32)
        return parts.view(np.complex64)[..., 0] * np.float32(self.level(db) / np.sqrt(2))

    def none(self):
        return self.rows

    def continuous_wave(self, db=30, tone_hz=13.0):
        phase = 2 * np.pi * tone_hz * self.t_s[:, None] + np.linspace(0, 7, self.rows.shape[1])
        return self.rows + self.is_on * self.level(db) * np.exp(1j * phase)

    def shaped_noise(self):
        shape = 10 ** (np.linspace(-20, 0, self.rows.shape[1]) / 20)
        return self.rows + self.is_on * self.white(40) * shape

    def pulses(self):
        is_pulse = (np.arange(len(self.rows)) % 30 < 4)[:, None]
        return self.rows + self.is_on * is_pulse * self.white(40)

    def _far(self):
        """Where the far three fifths of the swath are, (n_range,)."""
        return np.arange(self.rows.shape[1]) >= 0.4 * self.rows.shape[1]

    def far_tone(self):
        return np.where(self._far(), self.continuous_wave(), self.rows)

    def far_noise(self):
        return self.rows + self.is_on * self.white(30) * self._far()

    def far_pulses(self):
        return np.where(self._far(), self.pulses(), self.rows)

    def third_noise(self):
        share = np.arange(self.rows.shape[1]) / self.rows.shape[1]
        return self.rows + self.is_on * self.white(30) * ((share >= 0.3) & (share < 0.65))

    def white_noise(self):
        return self.rows + self.is_on * self.white(20)

    def ramp(self, db_per_s=0.06):
        power = 10 ** (db_per_s * np.maximum(self.t_s - ON_S, 0) / 10) - 1
        return self.rows + self.white(0) * np.sqrt(power)[:, None]

    def saturation(self):
        loud = np.ascontiguousarray(self.rows * 1e3 + self.white(60), np.complex64)
        clipped = np.clip(loud.view(np.float32), -0.5, 0.5).view(np.complex64)
        return np.where(self.is_on, clipped, self.rows)

    def stuck(self):
        return np.where(self.is_on, np.complex64(50), self.rows).astype(np.complex64)

    def reflector(self):
        near = np.zeros(self.rows.shape[1], np.complex64)
        near[:14] = 20 * np.exp(2j * np.pi * self.rng.random(14))
        return np.where(self.is_on, self.rows * 0.1 + near + self.white(0), self.rows)

    def unplugged(self):
        return np.where(self.is_on, self.white(0), self.rows)

    def second_radar(self, drift_mps=0.35):
        """Its pulse drifts through the swath, since its clock is another."""
        n_range, bin_m = self.rows.shape[1], self.axis.bin_length_m
        at = (self.t_s * drift_mps / bin_m) % n_range
        turns = 2 * drift_mps * self.t_s * self.axis.carrier_hz / 299_792_458
        wander = np.cumsum(self.rng.standard_normal(len(at)) * 0.02)
        pulse = np.exp(-0.5 * ((np.arange(n_range) - at[:, None]) / 1.5) ** 2)
        phase = np.exp(2j * np.pi * (turns + wander))[:, None]
        return self.rows + self.is_on * self.level(40) * pulse * phase

    def same_pulse(self):
        """A radar that keeps step with this one, so that its pulse stays where it is."""
        return np.roll(self.second_radar(0.0) - self.rows, 30, axis=1) + self.rows


def judged(rows, stream, axis, *, model="accurate"):
    """The events of frames."""
    rows = np.ascontiguousarray(rows, np.complex64)
    # So that one visit's alarm is over before the next.
    config = Config(alarm=AlarmSection(latch_s=5, refractory_s=0))
    classifier = Classifier(load_bundle(model)) if model else None
    pipeline = Pipeline(stream, config, classifier, judges_tracks=False)
    tracker = EventTracker(AlarmPanel(alarm_policy(config.alarm, pipeline.policy)))
    pipeline.tamper = TamperWatch(config.tamper)
    n_slow, events = pipeline.shape.n_slow, []
    for end in range(n_slow, len(rows) + 1, RATE_HZ):
        dwell = dwell_of(rows[end - n_slow : end], RATE_HZ, axis=axis, end=end)
        events += tracker.on_decision(pipeline.decide(dwell), dwell)
    return events


def spans(events, *kinds):
    """From when to when something of these kinds was on."""
    ends = {e.id: e.t_s for e in events if e.phase == "end"}
    new = [e for e in events if e.kind in kinds and e.phase == "new"]
    return [(e.t_s, ends.get(e.id, np.inf)) for e in new]


def announced(events, *kinds, n_walks):
    """How many of the walk-ins fell into something of these kinds."""
    on, starts = spans(events, *kinds), [FIRST_S + k * EVERY_S for k in range(n_walks)]
    return sum(any(a <= s + VISIT_S + 1 and b >= s for a, b in on) for s in starts)
