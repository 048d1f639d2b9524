"""Micro-Doppler by Gram matrices, and the steps from frame to frame that it is made of."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp import doppler
from radard.dsp.columns import StepBuffer, blocks
from radard.errors import FeatureError
from tests.dsp_reference import error, micro_doppler_direct, under_clutter
from tests.radar_helpers import noise

LIGHT_MPS = 299_792_458.0


@pytest.mark.parametrize("clutter_db", [0, 80, 90, 95, 100, 140])
def test_clutter_does_not_hide_motion_in_wide_frames(clutter_db):
    # At 90 to 100 dB float32 sums of squares of whole quanta would all be rounded one way.
    frames = under_clutter(noise(100, 768, seed=1), clutter_db)
    assert error(doppler.micro_doppler(frames, 28), micro_doppler_direct(frames, 28)) < 1e-5


@pytest.mark.parametrize("level", [1e-44, 1e-42, 1e-38, 1e-30, 1e-12, 1e12, 1e19, 1e30, 1e37])
def test_levels_from_denormal_to_the_end(level):
    frames = (noise(60, 8) * level).astype(np.complex64)
    stream = doppler.StreamingDoppler(20)
    stream.push(frames)
    assert error(stream.columns(), micro_doppler_direct(frames, 20)) < 1e-5
    # Power beyond float32 is its largest number.
    frames = (noise(40, 4) * np.float32(1e25)).astype(np.complex64)
    assert doppler.micro_doppler(frames, 28).max() == np.finfo(np.float32).max
    assert not doppler.micro_doppler(frames * np.float32(1e-25) * np.float32(1e-30), 28).any()


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
    fold = LIGHT_MPS / carrier_hz * rate_hz / 2
    folded = (speed + fold / 2) % fold - fold / 2
    step = fold / n_cpi
    if abs(folded) < 2 * step:
        return  # in the clutter notch
    axis = doppler.velocity_mps(n_cpi, rate_hz, carrier_hz)
    found = axis[doppler.micro_doppler(frames, n_cpi)[:, 0].argmax()]
    assert abs((found - folded + fold / 2) % fold - fold / 2) < 0.75 * step


@pytest.mark.parametrize("rate_hz", [1.0, 60.0, 1000.0])
@pytest.mark.parametrize("n_cpi", [2, 28, 29])
def test_axes(n_cpi, rate_hz):
    axis = doppler.doppler_hz(n_cpi, rate_hz)
    assert (axis.shape, axis[n_cpi // 2]) == ((n_cpi,), 0)
    assert np.all(np.diff(axis) > 0)
    most_mps = LIGHT_MPS / 6.8e9 * rate_hz / 4
    assert abs(doppler.velocity_mps(n_cpi, rate_hz, 6.8e9)).max() <= most_mps * (1 + 1e-12)


@pytest.mark.parametrize("shape", [(5, 4), (27, 8), (28,), (28, 2, 2)])
def test_too_short(shape):
    with pytest.raises(FeatureError, match="cannot fill"):
        doppler.micro_doppler(np.zeros(shape, np.complex64), 28)


def steps_of(frames, valid=None, *, n_block=64):
    """All steps of a record as complex128, and the flags."""
    frames = np.asarray(frames)
    buffer = StepBuffer(len(frames), n_block)
    for part, flags in blocks(frames, valid, n_block):
        buffer.push(part, flags)
    rows = buffer.rows(len(frames)).astype(np.float64)
    return rows[:, : buffer.n_range] + 1j * rows[:, buffer.n_range :], buffer.flags(len(frames))


WIDTHS = ["<c8", ">c8", "<c16", ">c16", "<f4", ">f4", "<f8", "<f2", ">f2", "<i2", ">i2", "<i4"]


@pytest.mark.parametrize("dtype", WIDTHS)
@pytest.mark.parametrize("strided", [False, True])
def test_any_number_format(dtype, strided):
    rng = np.random.default_rng(3)
    values = rng.integers(-1000, 1000, (20, 8)).astype(np.float64)
    if np.dtype(dtype).kind == "c":
        values = values + 1j * rng.integers(-1000, 1000, (20, 8))
    frames = values.astype(dtype)
    if strided:
        frames = frames.repeat(2, axis=0).repeat(3, axis=1)[::2, 1::3]
    ours, _ = steps_of(frames)
    assert np.array_equal(ours[1:], np.diff(values, axis=0))


def test_numbers_at_the_ends_of_their_formats():
    ours, _ = steps_of(np.array([[-32768], [32767]], np.int16))
    assert ours[1, 0] == 65535
    # Double precision is rounded after the difference.
    frames = (1e9 + np.arange(4.0))[:, None] + 0j
    assert np.array_equal(steps_of(frames)[0][1:, 0], np.ones(3))
    # Levels at the ends of float32.
    tiny = np.arange(6, dtype=np.float32)[:, None] * np.float32(1e-45)
    assert np.array_equal(steps_of(tiny)[0][1:, 0], np.full(5, np.float32(1e-45)))
    ours, flags = steps_of(np.array([[9e37], [-9e37], [9e37]], np.float32))
    assert flags.all()
    assert np.allclose(ours[1:, 0], [-1.8e38, 1.8e38])


@pytest.mark.parametrize(
    ("frames", "valid", "says"),
    [
        (np.zeros((2, 3, 4)), None, "no record"),
        (np.zeros((2, 0)), None, "no record"),
        (np.array([["a", "b"]]), None, "no record"),
        (np.zeros((3, 4), np.bool_), None, "no record"),
        (np.zeros((3, 4)), [True, False], "2 flags"),
    ],
)
def test_what_is_no_record(frames, valid, says):
    with pytest.raises(FeatureError, match=says):
        list(blocks(frames, valid, 8))
