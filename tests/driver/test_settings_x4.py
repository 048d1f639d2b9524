import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from x2radar.device.assemble import FrameAssembler
from x2radar.errors import SettingsError
from x2radar.modules.x2 import RadarSettings
from x2radar.modules.x4 import X4Settings
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.wire import framing
from x2radar.wire.codec import decode_response, encode
from x2radar.wire.messages import BasebandIq, Data
from x2radar.wire.wire_ids import ContentId


def test_axis_of_both_forms():
    assert X4Settings(frame_rate_hz=17).bin_length_m == pytest.approx(0.0514, abs=1e-4)
    assert X4Settings(frame_rate_hz=17, is_baseband=False).bin_length_m == pytest.approx(
        0.00643, abs=1e-5
    )


def test_highest_frame_rate_of_the_user_guide():
    # XTAN-13: 152 thresholds, 64 iterations, 16 pulses, PRF 15.1875 MHz, duty 0.95.
    settings = X4Settings(frame_rate_hz=17)
    assert settings.highest_frame_rate_hz == pytest.approx(15.1875e6 * 0.95 / (64 * 16 * 152))


@pytest.mark.parametrize("name", ["frame_rate_hz", "area_start_m", "area_end_m", "area_offset_m"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, "3", None, 1e6, -2])
def test_numbers_out_of_range(name, bad):
    with pytest.raises(SettingsError, match=f"{name} = "):
        X4Settings(**{name: bad})


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("dac_min", 0, 2046),
        ("dac_max", 1, 2047),
        ("dac_step", 1, 255),
        ("pulses_per_step", 1, 65535),
        ("iterations", 1, 255),
        ("prf_divider", 6, 255),
        ("centre_frequency", 3, 4),
    ],
)
def test_whole_numbers_out_of_range(name, low, high):
    # One threshold and a slow frame leave room for every field's largest value.
    room = {"frame_rate_hz": 0.01, "dac_min": 0, "dac_max": 2047, "iterations": 1}
    for good in (low, high):
        assert getattr(X4Settings(**{**room, name: good}), name) == good
    for bad in (low - 1, 70_000, 2.5, math.nan, "3", None):
        with pytest.raises(SettingsError, match=f"{name} = "):
            X4Settings(**{**room, name: bad})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"frame_rate_hz": 900, "iterations": 255}, "allow 23.3"),
        ({"area_end_m": 0.1}, "area_end_m"),
        ({"area_start_m": 0, "area_end_m": 9.9}, "at most 9.87 m"),
        ({"centre_frequency": 5}, "must be one of 3, 4"),
        ({"dac_max": 10}, "dac_max = 10: must be above dac_min = 949"),
        ({"is_baseband": 1}, "must be one of True, False"),
        ({"iterations": 0, "prf_divider": 1}, "iterations.*prf_divider"),
        ({"area_end_m": 0.1, "dac_max": 9}, "area_end_m.*dac_max"),
    ],
)
def test_faults_are_named_all_at_once(changes, words):
    with pytest.raises(SettingsError, match=words):
        X4Settings(**changes)


@pytest.mark.parametrize("rate_hz", [0, -1, 1001, 1e9, math.nan, math.inf, "60", None])
def test_no_settings_for_what_is_no_frame_rate(rate_hz):
    with pytest.raises(SettingsError, match="frame_rate_hz"):
        X4Settings.for_frame_rate(rate_hz)


@given(st.floats(0.01, 1000))
def test_any_frame_rate_uses_the_time_it_has(rate_hz):
    s = X4Settings.for_frame_rate(rate_hz)
    assert s.frame_rate_hz == rate_hz <= s.highest_frame_rate_hz
    more = s.highest_frame_rate_hz * s.iterations / (s.iterations + 1)
    assert s.iterations == 64 or more < rate_hz


def test_raw_frames_become_what_the_settings_say():
    values = np.arange(12, dtype=np.float32)
    message = Data(ContentId.RAW_FRAME, 7, values)
    frame = FrameAssembler(X4Settings.for_frame_rate(17)).frame(message, 0.0)
    assert np.array_equal(frame.samples, values[:6] + 1j * values[6:])
    assert (frame.axis.kind, frame.axis.n_range) == ("baseband", 6)
    assert frame.axis.range_m[0] == pytest.approx(0.4)
    assert (frame.axis.carrier_hz, frame.axis.sample_rate_hz) == (7.29e9, 23.328e9)
    assert (frame.counter, frame.samples.dtype) == (7, np.complex64)
    assert not frame.samples.flags.writeable
    frame = FrameAssembler(X4Settings.for_frame_rate(17, is_baseband=False)).frame(message, 0.0)
    assert np.array_equal(frame.samples, values)
    assert frame.axis.kind == "rf"


def test_frames_off_the_wire_with_a_gap():
    rng = np.random.default_rng(1)
    echoes = rng.standard_normal((3, 2, 91)).astype(np.float32)
    assembler = FrameAssembler(X4Settings())
    frames = [
        assembler.frame(decode_response(encode(Data(ContentId.RAW_FRAME, n, e.ravel()))), 0.0)
        for n, e in zip((5, 6, 9), echoes, strict=True)
    ]
    assert [(f.counter, f.lost) for f in frames] == [(5, 0), (6, 0), (9, 2)]
    for frame, (i, q) in zip(frames, echoes, strict=True):
        assert np.array_equal(frame.samples, i + 1j * q)
        assert frame.axis is frames[0].axis


@pytest.mark.parametrize("packing", [framing.Packing.ESCAPED, framing.Packing.LENGTH])
def test_frames_in_either_packing(packing):
    values = np.linspace(-1, 1, 182, dtype=np.float32)
    wire = framing.encode(encode(Data(ContentId.RAW_FRAME, 1, values)), packing)
    (item,) = framing.PacketDecoder().feed(wire)
    frame = FrameAssembler(X4Settings()).frame(decode_response(item.data), 0.0)
    assert np.array_equal(frame.samples, values[:91] + 1j * values[91:])


def test_baseband_messages_bring_their_own_axis():
    values = np.ones(4, np.float32)
    message = BasebandIq(1, 0.05144033, 2.916e9, 7.29e9, 0.334321, values, values)
    axis = FrameAssembler(X4Settings(is_baseband=False)).frame(message, 0.0).axis
    assert (axis.kind, axis.n_range, axis.range_offset_m) == ("baseband", 4, 0.334321)


def test_port_key_device():
    radar = make_radar(parse_port("/dev/ttyX?device=x4m03&rate=20"))
    assert radar.settings == X4Settings.for_frame_rate(20)
    assert isinstance(make_radar(parse_port("/dev/ttyX?device=x2raw")).settings, RadarSettings)
    with pytest.raises(SettingsError, match="known are auto, x2raw, x2m200, x4m03"):
        make_radar(parse_port("/dev/ttyX?device=x9"))
    with pytest.raises(SettingsError, match="known are x2raw, x2m200, x4m03"):
        make_radar(parse_port("sim:human?device=auto"))
