"""Slower streams: means of frames, made from steps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.velocity import FrameMeans
from radard.judge.features import FeatureSettings, extract
from tests.radar_helpers import dwell_of, noise, walker


def frames_of(n, n_freq=5, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, n_freq)) + 1j * rng.standard_normal((n, n_freq))


def steps_of(frames):
    return np.diff(frames, axis=0, prepend=frames[:1]).astype(np.complex64)


def wanted(frames, n_mean):
    n = len(frames) // n_mean
    means = frames[: n * n_mean].reshape(n, n_mean, -1).mean(axis=1)
    return np.diff(means, axis=0)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    n_mean=st.sampled_from([1, 2, 3, 7]),
    n=st.integers(7, 41),
    cut=st.integers(1, 41),
    bad=st.sets(st.integers(0, 40), max_size=3),
)
def test_steps_lead_from_mean_to_mean_however_they_are_cut(n_mean, n, cut, bad):
    frames, good = frames_of(n), np.array([k not in bad for k in range(n)])
    steps, stream = steps_of(frames), FrameMeans(n_mean)
    # What came before a restart is forgotten.
    stream.add(steps_of(frames_of(5, seed=1)), np.ones(5, bool))
    stream.restart()
    parts = [stream.add(steps[k : k + cut], good[k : k + cut]) for k in range(0, n, cut)]
    made, flags = (np.concatenate(part) for part in zip(*parts, strict=True))
    assert len(made) == n // n_mean
    assert made[1:] == pytest.approx(wanted(frames, n_mean), abs=1e-5)
    # A mean with a bad frame is bad, and no other.
    assert flags.tolist() == good[: len(made) * n_mean].reshape(-1, n_mean).all(axis=1).tolist()


@pytest.mark.parametrize(("rate_hz", "n_mean"), [(60.0, 1), (108.0, 1), (120.0, 2), (200.0, 3)])
def test_the_long_map_keeps_the_frames_that_its_velocities_need(rate_hz, n_mean):
    grid = FeatureSettings(long_sampling=1.0).velocity_grids()["velocity_time_long"]
    dwell = dwell_of(noise(round(2.46 * rate_hz)), rate_hz=rate_hz)
    transform = grid.transform(dwell)
    # 4 f v / c of 0.6 m/s at 6.8 GHz is 54.4 Hz.
    assert transform.n_cpi == round(1.5 * rate_hz / n_mean)
    assert transform.column_rate_hz == pytest.approx(
        rate_hz / n_mean / transform.stride, rel=1e-12
    )


def test_a_slow_body_looks_the_same_with_fewer_frames():
    frames = walker(492, 200, speed_mps=0.3, start_m=2, level=3000) + noise(492)
    dwell, maps = dwell_of(frames, rate_hz=200.0), []
    for sampling in (0.0, 1.0):
        made = extract(dwell, FeatureSettings(long_sampling=sampling), ("velocity_time_long",))
        maps.append(made["velocity_time_long"])
    every, fewer = maps
    assert every.any()
    assert not np.array_equal(every, fewer)
    grid = FeatureSettings().velocity_grids()["velocity_time_long"]
    for each in maps:
        velocity_mps = (each.argmax(axis=0) - len(each) // 2) * grid.step_mps
        assert velocity_mps == pytest.approx(0.3, abs=0.016)
