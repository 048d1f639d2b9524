import math

import numpy as np
import pytest

from radard.dsp.downconvert import DownConverter
from tests.sim_helpers import BASEBAND, RF, affected, room_echo
from x2radar.sim.signal.receiver import MIDDLE, FrameDraws, ReceiverEffects

EVERYTHING = ReceiverEffects(
    jitter_s=0.2e-12,
    gain_noise=0.001,
    frame_jitter=0.03,
    burst_rate_hz=2,
    spike_share=0.2,
    lost_share=0.1,
)


def table(draws, first, n):
    row, column, counts = draws.spikes(first, n, 768)
    spiked = np.zeros((n, 768))
    spiked[row, column] = counts
    drawn = (draws.delay_s, draws.gain, draws.times_s, draws.noise_gain, draws.lost)
    return np.column_stack([*(each(first, n) for each in drawn), spiked])


def test_draws_belong_to_the_frame_number_and_what_is_off_is_exactly_off():
    whole = table(FrameDraws(EVERYTHING, 1, 60), 0, 700)
    again = FrameDraws(EVERYTHING, 1, 60)
    for first, n in ((690, 10), (0, 1), (255, 2), (256, 256), (100, 500), (699, 1), (3, 0)):
        assert np.array_equal(table(again, first, n), whole[first : first + n])
    other = table(FrameDraws(EVERYTHING, 2, 60), 0, 700)
    assert not np.any(other[:, 0] == whole[:, 0])
    draws = FrameDraws(ReceiverEffects(), 0, 60)
    assert np.array_equal(draws.times_s(5, 3), np.array([5, 6, 7]) / 60)
    assert not draws.delay_s(0, 9).any()
    assert np.array_equal(draws.gain(0, 9), np.ones(9))
    assert np.array_equal(draws.noise_gain(0, 9), np.ones(9))
    assert not draws.lost(0, 9).any()
    assert all(x.size == 0 for x in draws.spikes(0, 9, 768))


@pytest.mark.parametrize("axis", [RF, BASEBAND], ids=["rf", "baseband"])
def test_all_effects_together_do_not_depend_on_blocks(axis):
    echo = room_echo(axis)[:300]
    kwargs = {k: getattr(EVERYTHING, k) for k in ("jitter_s", "burst_rate_hz", "spike_share")}
    whole = affected(axis, echo=echo, **kwargs)
    for sizes in ([1] * 300, [7, 0, 293], [256, 44]):
        assert np.array_equal(affected(axis, echo=echo, sizes=sizes, **kwargs), whole)


def test_frame_times_stay_in_order_and_within_five_percent():
    for jitter in (0.01, 0.05):
        t_s = FrameDraws(ReceiverEffects(frame_jitter=jitter), 0, 60).times_s(0, 20_000)
        late = t_s * 60 - np.arange(20_000)
        assert np.abs(late).max() <= 0.05 + 1e-9
        assert (np.diff(t_s) > 0.9 / 60 - 1e-12).all()
    assert late.std() > 0.03


def test_bursts_come_last_and_rise_as_asked():
    effects = ReceiverEffects(burst_rate_hz=0.5, burst_s=0.2)
    gain = FrameDraws(effects, 0, 60).noise_gain(0, 200_000)
    rise_db = 20 * np.log10(gain[gain > 1])
    assert rise_db.min() >= 3 - 1e-9
    assert rise_db.max() <= 20 + 1e-9
    # 0.5 bursts a second of 0.2 s (cut at 60 frames, rounded up by half a frame).
    assert (gain > 1).mean() == pytest.approx(1 - math.exp(-0.5 * 0.208), rel=0.08)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], gain > 1, [0]]).astype(int)))
    length = np.diff(ends)[::2]
    assert length.min() >= 1
    assert length.mean() == pytest.approx(0.21 * 60, rel=0.15)


def test_spikes_lie_above_the_converter_and_come_as_often_as_asked():
    frames = affected(n=2000, spike_share=0.05).real + MIDDLE
    counts = frames[frames > 100] / (100 / 8192)
    assert counts.min() >= 8192 - 1e-3
    assert counts.max() < 65536
    spiked = (frames > 100).sum(axis=1)
    assert (spiked > 0).mean() == pytest.approx(0.05, abs=0.015)
    assert set(spiked.tolist()) == {0, 1, 2, 3}


def test_a_baseband_spike_is_that_of_the_rf_frame():
    kwargs = {"spike_share": 0.3, "n": 40, "seed": 6}
    raw = affected(RF, **kwargs).real
    rf = DownConverter(RF).convert(raw.astype(np.float32))
    baseband = affected(BASEBAND, **kwargs)
    rows = np.flatnonzero(np.abs(baseband).max(axis=1) > 1)
    assert rows.size > 5
    # The converter takes the frame's mean off, at most 3 spikes of 750 over 768 samples.
    peak = np.abs(baseband[rows]).max()
    assert np.abs(rf[rows] - baseband[rows])[:, 60:-60].max() < 0.02 * peak
