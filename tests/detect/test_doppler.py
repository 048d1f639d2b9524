import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.doppler import (
    doppler_hz,
    micro_doppler,
    range_doppler,
    unambiguous_velocity_mps,
    velocity_mps,
)
from radard.errors import FeatureError
from tests.dsp_helpers import error, under_clutter
from tests.dsp_reference import micro_doppler_direct
from tests.radar_helpers import noise, walker

LIGHT_MPS = 299_792_458.0


@settings(deadline=None, derandomize=True, max_examples=40)
@given(n_cpi=st.integers(2, 40), more=st.integers(0, 70), seed=st.integers(0, 1000))
def test_gram_equals_definition(n_cpi, more, seed):
    frames = noise(n_cpi + more, 16, seed=seed)
    ours = micro_doppler(frames, n_cpi)
    assert ours.shape == (n_cpi, more + 1)
    assert ours.dtype == np.float32
    assert error(ours, micro_doppler_direct(frames, n_cpi)) < 1e-5


@pytest.mark.parametrize("n_range", [64, 768])
@pytest.mark.parametrize("clutter_db", [0, 40, 60, 80, 90, 95, 100, 110, 120, 130, 140])
def test_clutter_does_not_hide_motion(clutter_db, n_range):
    frames = under_clutter(noise(100, n_range, seed=1), clutter_db)
    assert error(micro_doppler(frames, 28), micro_doppler_direct(frames, 28)) < 1e-5


@pytest.mark.parametrize("clutter_db", [60, 100, 140])
@pytest.mark.parametrize("speed_mps", [0.02, 0.2, 1.2])
def test_clutter_does_not_hide_a_slow_point(clutter_db, speed_mps):
    frames = walker(100, 60, speed_mps=speed_mps, start_m=2, level=1)
    frames = under_clutter(frames, clutter_db)
    assert error(micro_doppler(frames, 28), micro_doppler_direct(frames, 28)) < 1e-5


def test_direct_form_in_extended_precision():
    frames = under_clutter(noise(20, 4), 140)
    y = frames.astype(np.clongdouble)
    taper = np.ones(9, np.longdouble)
    columns = []
    for i in range(12):
        z = taper[:, None] * (y[i : i + 9] - y[i : i + 9].mean(axis=0))
        columns.append(np.fft.fftshift((np.abs(np.fft.fft(z, axis=0)) ** 2).sum(axis=1)))
    wanted = np.stack(columns, axis=1).astype(np.float64)
    assert error(micro_doppler_direct(frames, 9, taper=np.ones(9)), wanted) < 1e-12


def test_still_scene_gives_exact_zero():
    frames = np.repeat(noise(1, 64, sigma=1e4), 100, axis=0)
    assert not micro_doppler(frames, 28).any()
    assert not micro_doppler(np.zeros((40, 8), np.complex64), 28).any()


def test_one_live_bin():
    frames = np.zeros((50, 300), np.complex64)
    frames[:, 137] = noise(50, 1)[:, 0]
    alone = micro_doppler_direct(frames[:, 137:138], 28)
    assert error(micro_doppler(frames, 28), alone) < 1e-5


@pytest.mark.parametrize("n_cpi", [2, 3, 4, 5, 16, 31, 93, 127, 128, 129, 200, 255, 256])
def test_cpi_of_any_length(n_cpi):
    frames = noise(n_cpi + 5, 6)
    assert error(micro_doppler(frames, n_cpi), micro_doppler_direct(frames, n_cpi)) < 1e-5


@pytest.mark.parametrize("dtype", [">c8", "<c16", ">c16", "<f4", "<f2", ">f2", "<i2", ">i2"])
def test_any_number_format(dtype):
    values = np.random.default_rng(0).integers(-500, 500, (60, 12, 2))
    frames = (values[..., 0] + 1j * values[..., 1]).astype(np.complex64)
    if np.dtype(dtype).kind != "c":
        frames = frames.real
    wanted = micro_doppler_direct(frames, 20)
    wide = np.zeros((120, 36), dtype)
    wide[::2, ::3] = frames
    assert error(micro_doppler(wide[::2, ::3], 20), wanted) < 1e-5
    assert error(micro_doppler(np.asfortranarray(frames.astype(dtype)), 20), wanted) < 1e-5


def test_power_beyond_float32_is_its_largest_number():
    frames = (noise(40, 4) * np.float32(1e25)).astype(np.complex64)
    ours = micro_doppler(frames, 28)
    assert np.isfinite(ours).all()
    assert ours.max() == np.finfo(np.float32).max
    assert not micro_doppler(frames * np.float32(1e-25) * np.float32(1e-30), 28).any()


@pytest.mark.parametrize("speed_mps", [0.3, 0.5])
def test_approaching_is_positive(speed_mps):
    frames = walker(147, 60, speed_mps=speed_mps, start_m=2, level=1)
    for sign, data in ((1, frames), (-1, frames[::-1].copy())):
        mu = micro_doppler(data, 28).mean(axis=1)
        line = doppler_hz(28, 60)[mu.argmax()]
        expected = sign * 2 * speed_mps * 6.8e9 / LIGHT_MPS
        assert line == pytest.approx(expected, abs=60 / 28)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    speed=st.floats(-15, 15),
    rate_hz=st.sampled_from([1, 17.06, 30.5, 60, 200, 1000]),
    carrier_hz=st.sampled_from([4.0e9, 6.8e9, 7.29e9]),
    n_cpi=st.integers(16, 60),
)
def test_velocity_axis_up_to_15_mps(speed, rate_hz, carrier_hz, n_cpi):
    t_s = np.arange(n_cpi) / rate_hz
    # One bin, so nothing walks through range: only the phase is looked at.
    frames = np.exp(4j * np.pi * carrier_hz / LIGHT_MPS * speed * t_s)[:, None]
    fold = 2 * unambiguous_velocity_mps(rate_hz, carrier_hz)
    folded = (speed + fold / 2) % fold - fold / 2
    step = fold / n_cpi
    if abs(folded) < 2 * step:
        return  # in the clutter notch
    axis = velocity_mps(n_cpi, rate_hz, carrier_hz)
    found = axis[micro_doppler(frames, n_cpi)[:, 0].argmax()]
    assert abs((found - folded + fold / 2) % fold - fold / 2) < 0.75 * step


@pytest.mark.parametrize("rate_hz", [1.0, 30.5, 60.0, 200.0, 1000.0])
@pytest.mark.parametrize("n_cpi", [2, 28, 29, 256])
def test_axes(n_cpi, rate_hz):
    axis = doppler_hz(n_cpi, rate_hz)
    assert axis.shape == (n_cpi,)
    assert axis[n_cpi // 2] == 0
    assert np.all(np.diff(axis) > 0)
    assert axis[0] >= -rate_hz / 2
    mps = velocity_mps(n_cpi, rate_hz, 6.8e9)
    assert np.allclose(mps, axis * LIGHT_MPS / 6.8e9 / 2)
    assert abs(mps).max() <= unambiguous_velocity_mps(rate_hz, 6.8e9) * (1 + 1e-12)


def test_the_x2_at_60_hz():
    assert unambiguous_velocity_mps(60, 6.8e9) == pytest.approx(0.66, abs=0.003)
    assert unambiguous_velocity_mps(200, 6.8e9) == pytest.approx(2.2, abs=0.01)


@pytest.mark.parametrize("n_cpi", [2, 28, 29])
@pytest.mark.parametrize("clutter_db", [0, 60, 140])
def test_range_doppler_is_what_mu_sums(n_cpi, clutter_db):
    cpi = under_clutter(noise(n_cpi, 40), clutter_db)
    g = range_doppler(cpi)
    assert g.shape == (n_cpi, 40)
    assert error(g.sum(axis=1), micro_doppler_direct(cpi, n_cpi)[:, 0]) < 1e-5
    for n in (0, 17):
        assert error(g[:, n], micro_doppler_direct(cpi[:, n : n + 1], n_cpi)[:, 0]) < 1e-5


@pytest.mark.parametrize("shape", [(5, 4), (27, 8), (28,), (28, 2, 2)])
def test_too_short(shape):
    with pytest.raises(FeatureError, match="cannot fill"):
        micro_doppler(np.zeros(shape, np.complex64), 28)
    with pytest.raises(FeatureError, match="cannot fill"):
        range_doppler(np.zeros(shape if len(shape) != 2 else (1, 4)))
