import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from x2radar.errors import SettingsError, X2RadarError
from x2radar.modules.x2 import PRF_HZ, PULSE_GENERATORS, RadarSettings

C = 299_792_458.0


def test_defaults_are_the_radar_of_the_thesis():
    s = RadarSettings()
    assert (s.frame_rate_hz, s.n_range, s.sample_rate_hz, s.sample_delay_s) == (
        60,
        768,
        41e9,
        4e-9,
    )
    assert (s.carrier_hz, s.bandwidth_hz, s.output) == (6.8e9, 2.3e9, "rf")
    assert s.bin_length_m == pytest.approx(3.656e-3, abs=1e-6)
    assert s.range_offset_m == pytest.approx(0.5996, abs=1e-4)
    assert s.range_offset_m + (s.n_range - 1) * s.bin_length_m == pytest.approx(3.404, abs=1e-3)
    # Three offsets, two thousand thresholds, 256 pulses each at 100 MHz.
    assert s.n_steps == 2048
    assert s.sweep_s == pytest.approx(3 * 2048 * 256 / 100e6)


def test_pulse_table():
    assert len(PULSE_GENERATORS) == 12
    assert RadarSettings(pulse_generator=0).carrier_hz == pytest.approx(5.3e9)
    last = RadarSettings(pulse_generator=11)
    assert (last.carrier_hz, last.bandwidth_hz) == pytest.approx((9.1e9, 3.1e9))
    for lower, upper in pairwise(PULSE_GENERATORS):
        assert lower.carrier_hz < upper.carrier_hz
        assert lower.bandwidth_hz <= upper.bandwidth_hz
        assert lower.power_dbm >= upper.power_dbm
    for row in PULSE_GENERATORS:
        assert 0.3 < row.bandwidth_hz / row.carrier_hz < 0.4


SHORT = {"frame_rate_hz": 1, "frame_stitch": 1}  # room for every field's largest value
LIMITS = [
    ("frame_rate_hz", 1, 1000, 0, 1001, {"iterations": 1}),
    ("frame_stitch", 1, 5, 0, 6, {"iterations": 1}),
    ("pulse_generator", 0, 11, -1, 12, {}),
    ("sample_delay_s", 0.0, 200e-9, -1e-12, 201e-9, {}),
    ("dac_min", 0, 8190, -1, 8192, {}),
    ("dac_max", 1, 8191, -1, 8192, {}),
    ("dac_step", 1, 1024, 0, 1025, {"iterations": 1}),
    ("pulses_per_step", 1, 65535, 0, 65536, {**SHORT, "dac_step": 1024, "iterations": 1}),
    ("iterations", 1, 65535, 0, 65536, {**SHORT, "dac_step": 1024, "pulses_per_step": 1}),
    ("sample_rate_hz", 1e9, 100e9, 0.99e9, 101e9, {}),
]


@pytest.mark.parametrize("row", LIMITS, ids=[row[0] for row in LIMITS])
def test_limits(row):
    name, low, high, below, above, other = row
    for good in (low, high):
        assert getattr(RadarSettings(**{**other, name: good}), name) == good
    is_whole = name not in {"sample_delay_s", "sample_rate_hz"}
    for bad in (below, above, math.nan, math.inf, -math.inf, "60", None, *[2.5] * is_whole):
        with pytest.raises(SettingsError, match=f"{name} = "):
            RadarSettings(**{**other, name: bad})


def test_numbers_of_numpy_are_numbers():
    s = RadarSettings(frame_stitch=np.int64(2), sample_delay_s=np.float32(0))
    assert s.n_range == 512


def test_all_faults_come_at_once():
    with pytest.raises(SettingsError) as caught:
        RadarSettings(frame_rate_hz=0, frame_stitch=9, dac_min=-1, iterations=0, output="x")
    text = str(caught.value)
    for name in ("frame_rate_hz", "frame_stitch", "dac_min", "iterations", "output"):
        assert f"{name} = " in text
    assert "\n" not in text
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, X2RadarError)
    assert caught.value.exit_code == 2


def test_sweep_must_fit_into_a_frame():
    fits = RadarSettings(frame_rate_hz=63)  # 15.73 ms of 15.87 ms
    assert fits.sweep_s * 63 <= 1
    with pytest.raises(SettingsError, match=r"would take 15.7 ms; at 64 Hz at most 254 fit"):
        RadarSettings(frame_rate_hz=64)


def test_every_whole_rate_gives_settings_that_fit():
    for rate in range(1, 1001):
        s = RadarSettings.for_frame_rate(rate)
        assert s.frame_rate_hz == rate
        assert s.sweep_s * rate <= 1
        # No more than one iteration of the sweep is left unused below its cap.
        one = s.sweep_s / s.iterations
        assert s.iterations == 64 or (s.sweep_s + one) * rate > 1


@given(st.floats(allow_nan=True, allow_infinity=True), st.sampled_from(["rf", "iq", "ap"]))
def test_any_rate_gives_settings_or_a_settings_error(rate, output):
    try:
        s = RadarSettings.for_frame_rate(rate, output=output)
    except SettingsError as err:
        assert not (1 <= rate <= 1000 and rate % 1 == 0)
        assert "frame_rate_hz" in str(err)  # noqa: PT017
    else:
        assert s.sweep_s * rate <= 1
        assert s.output == output


@given(
    st.integers(1, 5),
    st.tuples(st.integers(0, 8191), st.integers(0, 8191), st.integers(1, 1024)),
    st.integers(1, 300),
    st.integers(1, 1000),
)
def test_sweep_time_by_counting(stitch, thresholds, pulses, rate):
    low, high, step = thresholds
    try:
        s = RadarSettings(
            frame_rate_hz=rate,
            frame_stitch=stitch,
            dac_min=low,
            dac_max=high,
            dac_step=step,
            pulses_per_step=pulses,
            iterations=1,
        )
    except SettingsError:
        n = len(range(low, high + 1, step))
        assert high <= low or n * pulses * stitch * rate > PRF_HZ
    else:
        n = len(range(low, high + 1, step))
        assert s.n_steps == n
        assert s.sweep_s == pytest.approx(n * pulses * stitch / PRF_HZ)
