"""Settings of the modules: limits, what fits into a frame, and the commands that tell them."""

import math
from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from x2radar.device.assemble import FrameAssembler
from x2radar.errors import SettingsError
from x2radar.modules.profile import ProfileSettings
from x2radar.modules.x2 import PRF_HZ, PULSE_GENERATORS, RadarSettings
from x2radar.modules.x4 import X4Settings
from x2radar.wire import messages as msg
from x2radar.wire.codec import decode_response, encode
from x2radar.wire.wire_ids import ContentId, Mode, OutputRef, SysCfg, X4Setting


def test_defaults_are_the_radar_of_the_thesis_and_pulses_a_table():
    s = RadarSettings()
    assert (s.frame_rate_hz, s.axis.n_range, s.sample_rate_hz) == (60, 768, 41e9)
    assert (s.axis.carrier_hz, s.axis.bandwidth_hz, s.output) == (6.8e9, 2.3e9, "rf")
    assert s.axis.bin_length_m == pytest.approx(3.656e-3, abs=1e-6)
    assert s.axis.range_m[[0, -1]] == pytest.approx([0.5996, 3.404], abs=1e-3)
    # Three offsets, two thousand thresholds, 256 pulses each at 100 MHz.
    assert s.n_steps == 2048
    assert s.sweep_s == pytest.approx(3 * 2048 * 256 / 100e6)
    assert len(PULSE_GENERATORS) == 12
    assert RadarSettings(pulse_generator=0).axis.carrier_hz == pytest.approx(5.3e9)
    for lower, upper in pairwise(PULSE_GENERATORS):
        assert lower.carrier_hz < upper.carrier_hz
        assert lower.bandwidth_hz <= upper.bandwidth_hz
    for row in PULSE_GENERATORS:
        assert 0.3 < row.bandwidth_hz / row.carrier_hz < 0.4


# Room for the largest values of most fields: a slow frame, few thresholds.
FEW = {"iterations": 1, "pulses_per_step": 1, "dac_min": 0}
ROOM = {RadarSettings: {**FEW, "frame_rate_hz": 1, "frame_stitch": 1, "dac_step": 1024}}
ROOM |= {X4Settings: {**FEW, "frame_rate_hz": 0.01, "dac_max": 2047}, ProfileSettings: {}}
FIELDS = [(cls, field.name, field.metadata["key"]) for cls in ROOM for field in fields(cls)]


@pytest.mark.parametrize(("cls", "name", "key"), FIELDS)
def test_limits(cls, name, key):
    for good in key.choices or (key.low, key.high):
        try:
            assert getattr(cls(**{**ROOM[cls], name: good}), name) == good
        except SettingsError as err:
            # At its end alone; the others leave no room for it.
            assert "must be above" in str(err) or "iterations" in str(err)  # noqa: PT017
    step = 1e-3 * (key.high - key.low)
    bad = ["60", None, math.nan, math.inf, -math.inf, key.low - step, key.high + step]
    for value in [*bad, key.low + 0.5] if key.is_whole else bad:
        with pytest.raises(SettingsError, match=f"{name} = "):
            cls(**{**ROOM[cls], name: value})


@pytest.mark.parametrize(
    ("cls", "changes", "words"),
    [
        (RadarSettings, {"dac_min": 4000, "dac_max": 4000}, "4000: must be above dac_min = 4000"),
        (RadarSettings, {"output": "baseband"}, "must be one of rf, iq, ap"),
        (RadarSettings, {"frame_rate_hz": 64}, "would take 15.7 ms; at 64 Hz at most 254 fit"),
        (RadarSettings, {"frame_stitch": 9, "output": "x"}, "frame_stitch = .*output = "),
        (X4Settings, {"frame_rate_hz": 900, "iterations": 255}, "allow 23.3"),
        (X4Settings, {"area_start_m": 0, "area_end_m": 9.9}, "at most 9.87 m"),
        (X4Settings, {"dac_max": 10}, "dac_max = 10: must be above dac_min = 949"),
        (X4Settings, {"is_baseband": 1}, "must be one of True, False"),
        (X4Settings, {"dac_step": 2.5}, "must be a whole number"),
        (X4Settings, {"area_end_m": 0.1, "dac_max": 9}, "area_end_m.*dac_max"),
    ],
)
def test_faults_are_named_all_at_once(cls, changes, words):
    with pytest.raises(SettingsError, match=words) as caught:
        cls(**changes)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2


@given(
    st.integers(1, 1000) | st.floats(allow_nan=True, allow_infinity=True),
    st.sampled_from(["rf", "iq", "ap"]),
)
@settings(max_examples=1000)
def test_any_rate_gives_settings_that_fit_or_a_settings_error(rate, output):
    try:
        s = RadarSettings.for_frame_rate(rate, output=output)
    except SettingsError as err:
        assert not (1 <= rate <= 1000 and rate % 1 == 0)
        assert "frame_rate_hz" in str(err)  # noqa: PT017
    else:
        assert (s.frame_rate_hz, s.output) == (rate, output)
        assert s.sweep_s * rate <= 1
        # No more than one iteration of the sweep is left unused below its cap.
        one = s.sweep_s / s.iterations
        assert s.iterations == 64 or (s.sweep_s + one) * rate > 1


@pytest.mark.parametrize("rate_hz", [0, -1, 1001, 1e9, math.nan, math.inf, "60", None])
def test_an_x4_has_no_settings_for_what_is_no_frame_rate(rate_hz):
    with pytest.raises(SettingsError, match="frame_rate_hz"):
        X4Settings.for_frame_rate(rate_hz)


@given(st.floats(0.01, 1000))
def test_any_frame_rate_of_an_x4_uses_the_time_it_has(rate_hz):
    s = X4Settings.for_frame_rate(rate_hz)
    assert s.frame_rate_hz == rate_hz <= s.highest_frame_rate_hz
    more = s.highest_frame_rate_hz * s.iterations / (s.iterations + 1)
    assert s.iterations == 64 or more < rate_hz


@given(
    st.integers(1, 5),
    st.tuples(st.integers(0, 8191), st.integers(0, 8191), st.integers(1, 1024)),
    st.integers(1, 300),
    st.integers(1, 1000),
)
def test_sweep_time_by_counting(stitch, thresholds, pulses, rate):
    low, high, step = thresholds
    n = len(range(low, high + 1, step))
    known = {"frame_rate_hz": rate, "frame_stitch": stitch, "iterations": 1}
    known |= {"dac_min": low, "dac_max": high, "dac_step": step, "pulses_per_step": pulses}
    try:
        s = RadarSettings(**known)
    except SettingsError:
        assert high <= low or n * pulses * stitch * rate > PRF_HZ
    else:
        assert s.n_steps == n
        assert s.sweep_s == pytest.approx(n * pulses * stitch / PRF_HZ)


def test_axis_and_highest_frame_rate_of_an_x4():
    s = X4Settings(frame_rate_hz=17)
    assert s.axis.bin_length_m == pytest.approx(0.0514, abs=1e-4)
    rf = X4Settings(frame_rate_hz=17, is_baseband=False)
    assert rf.axis.bin_length_m == pytest.approx(0.00643, abs=1e-5)
    # XTAN-13: 152 thresholds, 64 iterations, 16 pulses, PRF 15.1875 MHz, duty 0.95.
    assert s.highest_frame_rate_hz == pytest.approx(15.1875e6 * 0.95 / (64 * 16 * 152))


def test_frames_of_an_x4_off_the_wire():
    echoes = np.random.default_rng(1).standard_normal((3, 2, 91)).astype(np.float32)
    raw = [msg.Data(ContentId.RAW_FRAME, n, echo.ravel()) for n, echo in enumerate(echoes)]
    messages = [decode_response(encode(each)) for each in raw]
    assembler = FrameAssembler(X4Settings())
    frames = [assembler.frame(message, 0.0) for message in messages]
    for frame, (i, q) in zip(frames, echoes, strict=True):
        assert np.array_equal(frame.samples, i + 1j * q)
    axis = frames[0].axis
    assert (axis.kind, axis.n_range, axis.sample_rate_hz) == ("baseband", 91, 23.328e9)
    rf = FrameAssembler(X4Settings.for_frame_rate(17, is_baseband=False))
    frame = rf.frame(messages[0], 0.0)
    assert np.array_equal(frame.samples, echoes[0].ravel())
    assert frame.axis.kind == "rf"
    ones = np.ones(4, np.float32)
    axis = rf.frame(msg.BasebandIq(1, 0.05144033, 2.916e9, 7.29e9, 0.334321, ones, ones), 0.0).axis
    assert (axis.kind, axis.n_range, axis.range_offset_m) == ("baseband", 4, 0.334321)


@pytest.mark.parametrize(("output", "value"), [("rf", 0), ("iq", 1), ("ap", 2)])
def test_commands_of_an_x2(output, value):
    s = RadarSettings(frame_rate_hz=20, pulse_generator=6, frame_stitch=2, output=output)
    first, *between, last = s.startup_commands()
    assert (first, last) == (msg.SetMode(Mode.IDLE), msg.SetMode(Mode.MANUAL))
    assert between[-1] == msg.SetOutput(OutputRef.BASEBAND, value)
    assert msg.SetSysFloat(SysCfg.SAMPLE_DELAY, s.sample_delay_s) in between
    for key, number in ((SysCfg.FPS, 20), (SysCfg.PG_SELECT, 6), (SysCfg.FRAME_STITCH, 2)):
        assert msg.SetSysInt(key, number) in between


def test_commands_of_an_x4():
    known = {
        X4Setting.DOWN_CONVERSION: {"is_baseband": False},
        X4Setting.TX_CENTRE_FREQUENCY: {"centre_frequency": 4},
        X4Setting.PRF_DIV: {"prf_divider": 8},
        X4Setting.ITERATIONS: {"iterations": 16},
        X4Setting.PULSES_PER_STEP: {"pulses_per_step": 10},
        X4Setting.DAC_STEP: {"dac_step": 2},
        X4Setting.DAC_MIN: {"dac_min": 900},
        X4Setting.DAC_MAX: {"dac_max": 1150},
        X4Setting.FRAME_AREA_OFFSET: {"area_offset_m": 0.25},
        X4Setting.FRAME_AREA: {"area_start_m": 0.5, "area_end_m": 4},
    }
    fields = {name: value for some in known.values() for name, value in some.items()}
    commands = X4Settings(frame_rate_hz=20, **fields).startup_commands()
    begin, between, last = commands[:3], commands[3:-1], commands[-1]
    assert [*begin] == [msg.SetMode(Mode.STOP), msg.SetMode(Mode.MANUAL), msg.X4Init()]
    assert last == msg.X4Set(X4Setting.FPS, (20,))
    assert set(between) == {msg.X4Set(ref, tuple(some.values())) for ref, some in known.items()}
    told = [command.setting for command in between]
    assert told.index(X4Setting.FRAME_AREA_OFFSET) < told.index(X4Setting.FRAME_AREA)
