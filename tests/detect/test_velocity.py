"""The velocity transform on any radar, and of slower streams: means of frames."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.velocity import FrameMeans, VelocityTransform, range_frequencies
from radard.errors import FeatureError
from radard.judge.features import FeatureSettings, extract
from tests.dsp_reference import P4XX, X2, X4, error, point
from tests.radar_helpers import dwell_of, noise, walker

LIGHT_MPS = 299_792_458.0


def columns(frames, axis, rate_hz):
    stream = VelocityTransform(axis, rate_hz)
    stream.push(frames)
    return stream.columns()


def passing(axis, rate_hz, speed_mps, **kwargs):
    """Mean column of a point that passes the middle of the swath."""
    stream = VelocityTransform(axis, rate_hz, step_mps=0.02, column_rate_hz=1e9, **kwargs)
    middle_m = float(axis.range_m[axis.n_range // 2])
    stream.push(point(axis, rate_hz, stream.n_cpi + 6, velocity_mps=speed_mps, middle_m=middle_m))
    return stream.velocity_mps, stream.columns().mean(axis=1)


RADARS = [
    *((X2, 30.0, 2.5), (X2, 60.0, 5.0), (X2, 200.0, 8.0), (P4XX, 30.5, 3.5)),
    *((X4, 17.06, 0.5), (X4, 50.0, 3.0), (X4, 200.0, 6.0)),
]


@pytest.mark.parametrize(("axis", "rate_hz", "least_db"), RADARS)
@pytest.mark.parametrize("speed_mps", [0.6, 1.2, 2.0, 3.6, -1.2, -3.6])
def test_true_velocity_and_suppressed_aliases(axis, rate_hz, least_db, speed_mps):
    grid, power = passing(axis, rate_hz, speed_mps)
    assert grid[power.argmax()] == pytest.approx(speed_mps, abs=0.03)
    alias_mps = LIGHT_MPS / axis.carrier_hz * rate_hz / 2
    elsewhere = np.abs(grid - speed_mps) > alias_mps / 2
    assert 10 * np.log10(power.max() / power[elsewhere].max()) > least_db


@pytest.mark.parametrize("speed_mps", [7.0, -11.0, 15.0])
def test_velocities_to_15_mps(speed_mps):
    # At 15 m/s the point crosses a swath of 7 m in 0.47 s: the swath of an X4.
    grid, power = passing(replace(X4, n_range=182), 200.0, speed_mps, max_mps=16.0)
    assert grid[power.argmax()] == pytest.approx(speed_mps, abs=0.05)


@pytest.mark.parametrize("step", [2, 4])
def test_decimated_bins_give_the_same_map(step):
    fine = replace(X2, n_range=384, bin_length_m=X2.bin_length_m / 4)
    frames = point(fine, 60.0, 40, velocity_mps=1.0, middle_m=2.0)
    coarse = replace(fine, n_range=384 // step, bin_length_m=fine.bin_length_m * step)
    ours = columns(frames[:, ::step], coarse, 60.0) * step
    assert error(ours, columns(frames, fine, 60.0)) < 1e-3


def test_frequencies():
    f = range_frequencies(replace(X2, n_range=768, bin_length_m=0.003656))
    assert len(f) == 49
    assert f[24] == 6.8e9
    assert f[-1] - 6.8e9 == pytest.approx(1.28e9, abs=0.03e9)
    assert (len(range_frequencies(X4)), len(range_frequencies(P4XX))) == (49, 57)
    assert range_frequencies(replace(X2, bandwidth_hz=0.0))[0] > 5.8e9
    for wrong in (replace(X2, carrier_hz=0.0), replace(X2, bin_length_m=0.0)):
        with pytest.raises(FeatureError, match="no frequencies"):
            range_frequencies(wrong)


def spectra_of(n, n_freq=5, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n, n_freq)) + 1j * rng.standard_normal((n, n_freq))


def steps_of(frames):
    return np.diff(frames, axis=0, prepend=frames[:1]).astype(np.complex64)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    n_mean=st.sampled_from([1, 2, 3, 7]),
    n=st.integers(7, 41),
    cut=st.integers(1, 41),
    bad=st.sets(st.integers(0, 40), max_size=3),
)
def test_steps_lead_from_mean_to_mean_however_they_are_cut(n_mean, n, cut, bad):
    frames, good = spectra_of(n), np.array([k not in bad for k in range(n)])
    steps, stream = steps_of(frames), FrameMeans(n_mean)
    parts = [stream.add(steps[k : k + cut], good[k : k + cut]) for k in range(0, n, cut)]
    made, flags = (np.concatenate(part) for part in zip(*parts, strict=True))
    means = frames[: len(made) * n_mean].reshape(n // n_mean, n_mean, -1).mean(axis=1)
    assert made[1:] == pytest.approx(np.diff(means, axis=0), abs=1e-5)
    # A mean with a bad frame is bad, and no other.
    assert flags.tolist() == good[: len(made) * n_mean].reshape(-1, n_mean).all(axis=1).tolist()


@pytest.mark.parametrize(("rate_hz", "n_mean"), [(60.0, 1), (108.0, 1), (120.0, 2), (200.0, 3)])
def test_the_long_map_keeps_the_frames_that_its_velocities_need(rate_hz, n_mean):
    grid = FeatureSettings(long_sampling=1.0).velocity_grids()["velocity_time_long"]
    transform = grid.transform(dwell_of(noise(round(2.46 * rate_hz)), rate_hz=rate_hz))
    # 4 f v / c of 0.6 m/s at 6.8 GHz is 54.4 Hz.
    assert transform.n_cpi == round(1.5 * rate_hz / n_mean)
    wanted_hz = rate_hz / n_mean / transform.stride
    assert transform.column_rate_hz == pytest.approx(wanted_hz, rel=1e-12)


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
