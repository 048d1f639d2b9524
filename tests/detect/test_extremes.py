"""The whole chain at its extremes: clutter removal, gate, tracks, features of one dwell.

The routines by themselves are judged beside their own tests; here nothing may break between
them: always finite, pictures within 0 to 1, and the same picture whatever the unit.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.config.sections import GateSettings
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import Gate
from radard.detect.tracks import Tracker
from radard.judge.features import FEATURES, MAP_FEATURES, FeatureSettings, FeatureStream, extract
from tests.clutter_helpers import AXIS, body, room
from tests.dsp_reference import under_clutter
from tests.radar_helpers import dwell_of, noise

SETTINGS = FeatureSettings(n_profile=64, clutter="removed")


def walk(n_slow=147, rate_hz=60.0, axis=AXIS):
    """Somebody who walks out of a quiet room, in noise of one."""
    range_m = 1.2 + 0.8 * np.arange(n_slow) / rate_hz
    return (noise(n_slow, axis.n_range) + body(range_m, 40, axis)).astype(np.complex64)


def judged(dwell, names=FEATURES, settings_=SETTINGS):
    """Everything that is made of a dwell, checked for what must always hold."""
    moving = ClutterRemover().remove(dwell)
    gate = Gate(GateSettings())
    reading = gate.read(moving)
    tracks = Tracker().update(moving, gate.background)
    inputs = extract(moving, settings_, names)
    for name, values in inputs.items():
        assert values.dtype == np.float32
        assert np.isfinite(values).all(), name
        assert values.min() >= 0, name
        assert values.max() <= 1 + 1e-6, name
    assert np.isfinite([reading.power_db, reading.noise_floor_db, reading.threshold_db]).all()
    assert all(np.isfinite(track.range_m) for track in tracks)
    return reading, tracks, inputs


@pytest.mark.parametrize("exponent", [-140, -100, -60, -20, 20, 60, 100, 110])
def test_a_unit_that_is_a_power_of_two_changes_nothing(exponent):
    # From amplitudes around 1e-42, denormals, to 1e33.
    frames = walk()
    reading, tracks, inputs = judged(dwell_of(frames, axis=AXIS))
    scaled = np.ldexp(frames.view(np.float32), exponent).view(np.complex64)
    other, other_tracks, other_inputs = judged(dwell_of(scaled, axis=AXIS))
    assert other.is_open
    assert reading.is_open
    loose = exponent < -125
    wanted_db = pytest.approx(20 * np.log10(2.0) * exponent, abs=0.1 if loose else 1e-4)
    assert other.power_db - reading.power_db == wanted_db
    assert [t.id for t in other_tracks] == [t.id for t in tracks]
    for name, values in inputs.items():
        away = np.linalg.norm(other_inputs[name] - values)
        assert away <= (0.1 if loose else 1e-5) * np.linalg.norm(values), name


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, complex(0, np.nan), 1e39])
@pytest.mark.parametrize("position", [0, 1, 73, 146])
def test_frames_that_are_not_finite_are_lost_frames(bad, position):
    frames = walk()
    good = judged(dwell_of(frames, axis=AXIS))
    with np.errstate(over="ignore"):
        frames[position, 3] = np.complex64(bad)
    poisoned = judged(dwell_of(frames, axis=AXIS))
    lost = judged(dwell_of(np.nan_to_num(frames, posinf=0, neginf=0), lost=[position], axis=AXIS))
    assert poisoned[0] == lost[0]
    assert poisoned[0].power_db == pytest.approx(good[0].power_db, abs=0.2)
    for name, values in poisoned[2].items():
        assert np.array_equal(values, lost[2][name]), name


@pytest.mark.parametrize("rate_hz", [1.0, 4.0, 17.06, 30.0, 200.0, 1000.0])
def test_frame_rates(rate_hz):
    made = replace(SETTINGS, n_cpi=max(4, round(28 / 60 * rate_hz)), n_cadence=2, n_profile=24)
    shape = made.dwell_shape(1.0, rate_hz)
    axis = replace(AXIS, n_range=24, range_offset_m=1.0)
    dwell = dwell_of(walk(shape.n_slow, rate_hz, axis), rate_hz, axis=axis)
    reading, _, _ = judged(dwell, MAP_FEATURES, made)
    if rate_hz < 1000:
        judged(dwell, ("thesis_type1",), made)
    if rate_hz > 4:
        assert reading.is_open


@pytest.mark.parametrize("offset_m", [0.0, -1.0, 30.0])
def test_ranges_at_zero_behind_the_sensor_and_beyond_the_cells(offset_m):
    axis = replace(AXIS, range_offset_m=offset_m)
    frames = noise(147, 96)
    frames[:, 40] += 100 * np.exp(0.3j * np.arange(147))
    _, _, inputs = judged(dwell_of(frames.astype(np.complex64), axis=axis))
    if offset_m == 30.0:
        assert not inputs["range_time"].any()


def test_a_million_seconds_later_everything_is_the_same():
    frames = room(147 + 6 * 60)
    frames += body(np.linspace(3.2, 1.0, len(frames)), 40).astype(np.complex64)
    seen = []
    for later in (0, 60_000_000):
        remover, gate, tracker = ClutterRemover(), Gate(GateSettings()), Tracker()
        stream = FeatureStream(SETTINGS, MAP_FEATURES)
        mine = []
        for end in range(147, len(frames) + 1, 60):
            moving = remover.remove(dwell_of(frames[end - 147 : end], axis=AXIS, end=end + later))
            reading = gate.read(moving)
            tracks = tracker.update(moving, gate.background)
            features = stream.extract(moving)
            mine.append((reading, tracks, features))
        seen.append(mine)
    for (reading, tracks, features), later in zip(*seen, strict=True):
        assert later[0] == reading
        assert [t.id for t in later[1]] == [t.id for t in tracks]
        for ours, theirs in zip(tracks, later[1], strict=True):
            assert theirs.range_m == pytest.approx(ours.range_m, abs=1e-6)
        for name, values in features.items():
            assert np.array_equal(values, later[2][name])


@settings(deadline=None, derandomize=True, max_examples=40)
@given(
    seed=st.integers(0, 1 << 16),
    exponent=st.integers(-145, 115),
    clutter_db=st.floats(0, 140),
    spikes=st.lists(
        st.tuples(st.integers(0, 146), st.sampled_from([np.nan, np.inf, 1e30])), max_size=3
    ),
    still=st.booleans(),
)
def test_anything_at_once_stays_within_bounds(seed, exponent, clutter_db, spikes, still):
    frames = noise(147, 96, seed=seed)
    if not still:
        frames = (frames + walk()).astype(np.complex64)
    frames = under_clutter(frames, clutter_db, seed).view(np.float32)
    largest = int(np.frexp(np.abs(frames).max())[1])
    frames = np.ldexp(frames, min(exponent, 120 - largest)).view(np.complex64)
    for position, value in spikes:
        frames[position, position % 96] = value
    judged(dwell_of(frames, axis=AXIS))
