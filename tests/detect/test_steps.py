import numpy as np
import pytest

from radard.dsp.steps import StepBuffer, blocks
from radard.errors import FeatureError


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
        wide = np.zeros((40, 24), dtype)
        wide[::2, 1::3] = frames
        frames = wide[::2, 1::3]
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
    huge = np.array([[9e37], [-9e37], [9e37]], np.float32)
    ours, flags = steps_of(huge)
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
