import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.doppler import (
    doppler_hz,
    gaussian_taper,
    micro_doppler,
    micro_doppler_direct,
)
from radard.errors import FeatureError
from tests.radar_helpers import noise, walker


def error(ours: np.ndarray, reference: np.ndarray) -> float:
    return float(np.linalg.norm(ours - reference) / np.linalg.norm(reference))


@pytest.mark.parametrize("n_cpi", [2, 3, 9, 28, 29, 64])
def test_taper_is_one_tenth_at_both_ends(n_cpi):
    taper = gaussian_taper(n_cpi)
    assert taper[0] == pytest.approx(0.1, abs=1e-4)
    assert taper[-1] == pytest.approx(taper[0])
    assert taper.max() <= 1


@settings(deadline=None, derandomize=True, max_examples=40)
@given(n_cpi=st.integers(2, 40), more=st.integers(0, 70), seed=st.integers(0, 1000))
def test_gram_equals_definition(n_cpi, more, seed):
    frames = noise(n_cpi + more, 16, seed=seed)
    ours = micro_doppler(frames, n_cpi)
    assert ours.shape == (n_cpi, more + 1)
    assert ours.dtype == np.float32
    assert error(ours, micro_doppler_direct(frames, n_cpi)) < 1e-5


@pytest.mark.parametrize("clutter_db", [0, 60, 100])
def test_clutter_does_not_hide_motion(clutter_db):
    moving = noise(147, 64, seed=1)
    clutter = noise(1, 64, seed=2, sigma=10 ** (clutter_db / 20))
    frames = (moving + clutter).astype(np.complex64)
    assert error(micro_doppler(frames, 28), micro_doppler_direct(frames, 28)) < 1e-5


def test_still_scene_gives_exact_zero():
    frames = np.repeat(noise(1, 64, sigma=1e4), 100, axis=0)
    assert not micro_doppler(frames, 28).any()


@pytest.mark.parametrize("speed_mps", [0.3, 0.5])
def test_approaching_is_positive(speed_mps):
    frames = walker(147, 60, speed_mps=speed_mps, start_m=2, level=1)
    for sign, data in ((1, frames), (-1, frames[::-1].copy())):
        mu = micro_doppler(data, 28).mean(axis=1)
        line = doppler_hz(28, 60)[mu.argmax()]
        expected = sign * 2 * speed_mps * 6.8e9 / 299_792_458
        assert line == pytest.approx(expected, abs=60 / 28)


def test_doppler_axis():
    axis = doppler_hz(28, 60.0)
    assert axis[14] == 0
    assert np.all(np.diff(axis) > 0)
    assert doppler_hz(29, 60.0)[14] == 0


@pytest.mark.parametrize("shape", [(5, 4), (27, 8)])
def test_too_short(shape):
    with pytest.raises(FeatureError, match="cannot fill"):
        micro_doppler(np.zeros(shape, np.complex64), 28)
    with pytest.raises(FeatureError, match="cannot fill"):
        micro_doppler_direct(np.zeros(shape, np.complex64), 28)
