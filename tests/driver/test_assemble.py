"""Messages to frames: samples, axes, counters."""

import dataclasses
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import x2radar
from tests.recording_helpers import COUNTERS, make
from tests.sim_helpers import axis_with
from x2radar.device.assemble import FrameAssembler
from x2radar.errors import RecordingError, SceneError, SettingsError
from x2radar.frame import CounterTracker, Frame, Step
from x2radar.modules.x2 import RadarSettings
from x2radar.wire.codec import decode_response, encode
from x2radar.wire.messages import Ack, BasebandAp, BasebandIq, Data, Message, Unknown
from x2radar.wire.wire_ids import ContentId

SETTINGS = RadarSettings(sample_delay_s=10e-9, pulse_generator=6)
TOP = 2**32 - 1


def raw(counter: int, values: np.ndarray | None = None) -> Message:
    """Return a raw frame as it comes off the wire, in memory that is not aligned."""
    values = np.arange(8, dtype=np.float32) if values is None else values
    return decode_response(encode(Data(ContentId.RAW_FRAME, counter, values)))


def baseband(cls: type, counter: int, one: list, two: list, bin_length_m: float = 0.04) -> Message:
    return cls(counter, bin_length_m, 39e9, 6.8e9, 0.4, *np.array([one, two], np.float32))


def frames(messages: list[Message]) -> list[Frame | None]:
    assembler = FrameAssembler(SETTINGS)
    return [assembler.frame(message, 1.5) for message in messages]


def test_iq_frame_takes_its_axis_from_the_message() -> None:
    (frame,) = frames([baseband(BasebandIq, 3, [1, 2], [3, -4])])
    assert not frame.samples.flags.writeable
    assert frame.samples.dtype == np.complex64
    np.testing.assert_array_equal(frame.samples, [1 + 3j, 2 - 4j])
    axis = frame.axis
    assert (axis.kind, axis.n_range, axis.bin_length_m) == ("baseband", 2, 0.04)
    assert (axis.range_offset_m, axis.carrier_hz, axis.sample_rate_hz) == (0.4, 6.8e9, 39e9)
    assert axis.bandwidth_hz == 2.35e9
    np.testing.assert_allclose(axis.range_m, [0.4, 0.44])
    assert not axis.range_m.flags.writeable


def test_amplitude_and_phase_become_complex() -> None:
    (frame,) = frames([baseband(BasebandAp, 3, [1, 2, 0], [0, np.pi / 2, 1])])
    assert frame.samples.dtype == np.complex64
    np.testing.assert_allclose(frame.samples, [1, 2j, 0], atol=1e-6)


@pytest.mark.parametrize(
    "message",
    [
        *(Ack(), Unknown(b"\x02"), Data(ContentId.ENVELOPE, 1, np.zeros(3, np.float32))),
        *(Data(ContentId.RAW_FRAME, 1, np.zeros(3, np.uint8)), raw(1, np.zeros(0, np.float32))),
        *(baseband(cls, 1, [], []) for cls in (BasebandIq, BasebandAp)),
    ],
    ids=lambda m: type(m).__name__,
)
def test_messages_without_an_echo_are_no_frames(message: Message) -> None:
    none, frame = frames([message, raw(2)])
    # Nor do they count: the next frame is the first.
    assert (none, frame.index, frame.lost) == (None, 0, 0)


@pytest.mark.parametrize(
    ("counters", "told"),
    [
        ((1, 4), [(0, 0, False), (3, 2, False)]),
        ((900, 1, 2), [(0, 0, False), (1, 0, True), (2, 0, False)]),
        ((TOP, 0, 1), [(0, 0, False), (1, 0, False), (2, 0, False)]),
        ((TOP, 2), [(0, 0, False), (3, 2, False)]),
        ((1, 0), [(0, 0, False), (1, 0, True)]),
        ((1, 1, 1, 2), [(0, 0, False), (1, 0, False)]),
        ((0, 36_001), [(0, 0, False), (36_001, 36_000, False)]),
        ((0, 36_002), [(0, 0, False), (1, 0, True)]),
    ],
)
def test_what_counters_tell(counters: tuple[int, ...], told: list) -> None:
    got = frames([raw(counter) for counter in counters])
    assert [(f.index, f.lost, f.restarted) for f in got if f] == told


def test_another_echo_under_the_same_number_is_a_restart() -> None:
    """A counter that restarts at 1 right behind the first frame: found by campaigns/faults.py."""
    counts = Counter()
    assembler = FrameAssembler(SETTINGS, counts)
    other = raw(1, np.arange(1, 9, dtype=np.float32))
    got = [assembler.frame(message, 0.0) for message in (raw(1), other, other, raw(2))]
    assert [(f.index, f.lost, f.restarted) if f else None for f in got] == [
        *((0, 0, False), (1, 0, True), None, (2, 0, False))
    ]
    assert counts["repeated"] == 1


def test_the_axis_is_that_of_the_frame() -> None:
    longer = [1, 2, 3], [3, 4, 5]
    short = baseband(BasebandIq, 1, [1, 2], [3, 4])
    others = baseband(BasebandAp, 2, *longer), baseband(BasebandIq, 3, *longer, bin_length_m=0.05)
    one, two, other = frames([short, *others])
    assert (one.axis.n_range, two.axis.n_range, other.axis.bin_length_m) == (2, 3, 0.05)
    assert (two.index, other.index) == (1, 2)


AXIS = axis_with("rf", 4, 0.5, 2.0, bandwidth_hz=0, sample_rate_hz=0)


def test_range_axis() -> None:
    assert dataclasses.replace(AXIS, n_range=0).range_m.shape == (0,)
    np.testing.assert_array_equal(AXIS.range_m, [2.0, 2.5, 3.0, 3.5])
    assert AXIS.range_m.dtype == np.float64


@given(
    first=st.integers(0, TOP),
    ahead=st.lists(st.one_of(st.integers(0, 3), st.integers(1, 100)), max_size=30),
)
def test_index_counts_what_was_sent(first: int, ahead: list[int]) -> None:
    tracker = CounterTracker()
    tracker.update(first)
    index = 0
    for step in ahead:
        index += step
        kind, missing = tracker.update((first + index) % 2**32)
        assert tracker.index == index
        assert missing == max(step - 1, 0)
        assert (kind is Step.REPEAT) == (step == 0)
        assert (kind is Step.GAP) == (step > 1)


def test_a_recording_with_losses_ends_where_the_module_restarted(tmp_path):
    path, samples = make(tmp_path / "in.h5", "rf", [7, 8, 11, 12])
    rows, stream = x2radar.read_frames(path)
    assert np.isnan(rows[:, 0]).tolist() == [False, False, True, True, False, False]
    assert np.array_equal(rows[[0, 1, 4, 5]], samples)
    assert stream.axis.kind == "rf"
    assert rows.dtype == np.float32
    # Counters go 4294967290, 91, 94, 3, 4, 4, 5 and then to 900 million.
    path, samples = make(tmp_path / "other.h5", "baseband", COUNTERS)
    rows, _ = x2radar.read_frames(path)
    assert len(rows) == 12
    assert np.array_equal(rows[-1], samples[6])


def test_a_part_of_a_recording(tmp_path):
    path, samples = make(tmp_path / "in.h5", rate_hz=50.0)
    rows, _ = x2radar.read_frames(path, start_s=1.0, duration_s=0.5)
    assert np.array_equal(rows, samples[50:75])
    assert len(x2radar.read_frames(path, start_s=2.9)[0]) == 5
    with pytest.raises(RecordingError, match="no frame at or behind 3 s"):
        x2radar.read_frames(path, start_s=3.0)
    with pytest.raises(SettingsError, match="duration_s 0"):
        x2radar.read_frames(path, duration_s=0)


def test_a_scene_is_what_its_module_sends():
    samples, stream = x2radar.simulate("cat", duration_s=0.5, seed=2, kind="rf")
    with x2radar.open("sim:cat?seed=2&kind=rf", speed=None) as radar:
        frames = [frame for frame, _ in zip(radar, range(30), strict=False)]
        assert stream.axis == radar.stream.axis
    assert np.array_equal(samples, np.stack([frame.samples for frame in frames]))
    with pytest.raises(SceneError):
        x2radar.simulate("nobody")
    with pytest.raises(SettingsError):
        x2radar.simulate("cat", duration_s=4000)
