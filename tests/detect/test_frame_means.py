"""Slower streams: means of frames, made from steps."""

import numpy as np
import pytest

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


@pytest.mark.parametrize("n_mean", [1, 2, 3, 7])
@pytest.mark.parametrize("n", [7, 8, 41])
def test_steps_lead_from_mean_to_mean(n_mean, n):
    frames = frames_of(n)
    made, flags = FrameMeans(n_mean).add(steps_of(frames), np.ones(n, bool))
    assert len(made) == len(flags) == n // n_mean
    assert made[1:] == pytest.approx(wanted(frames, n_mean), abs=1e-5)
    assert flags.all()


@pytest.mark.parametrize("cut", [1, 2, 5])
def test_any_cut_into_blocks_gives_the_same(cut):
    frames, good = frames_of(31), np.ones(31, bool)
    good[11] = False
    steps = steps_of(frames)
    whole = FrameMeans(3).add(steps, good)
    stream = FrameMeans(3)
    parts = [stream.add(steps[k : k + cut], good[k : k + cut]) for k in range(0, len(steps), cut)]
    assert np.concatenate([p[0] for p in parts]) == pytest.approx(whole[0], abs=1e-6)
    assert np.concatenate([p[1] for p in parts]).tolist() == whole[1].tolist()


def test_a_mean_with_a_bad_frame_is_bad_and_no_other():
    good = np.ones(12, bool)
    good[5] = False
    _, flags = FrameMeans(3).add(steps_of(frames_of(12)), good)
    assert flags.tolist() == [True, False, True, True]


def test_restart_forgets():
    stream, frames = FrameMeans(2), frames_of(9)
    stream.add(steps_of(frames_of(5, seed=1)), np.ones(5, bool))
    stream.restart()
    made, _ = stream.add(steps_of(frames), np.ones(9, bool))
    assert made == pytest.approx(FrameMeans(2).add(steps_of(frames), np.ones(9, bool))[0])


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
        settings = FeatureSettings(long_sampling=sampling)
        maps.append(extract(dwell, settings, ("velocity_time_long",))["velocity_time_long"])
    every, fewer = maps
    assert every.any()
    assert not np.array_equal(every, fewer)
    grid = FeatureSettings().velocity_grids()["velocity_time_long"]
    for each in maps:
        velocity_mps = (each.argmax(axis=0) - len(each) // 2) * grid.step_mps
        assert velocity_mps == pytest.approx(0.3, abs=0.016)
