"""Detection on range-time and range-Doppler cells: false alarms, what it sees, what not."""

from dataclasses import replace

import numpy as np
import pytest

from radard.config.sections import GateSettings
from radard.detect.gate import DAY_S, Gate
from radard.dsp import cfar
from radard.dsp.cfar import FALSE_ALARM, PowerMap, find_peaks, floor_factor, os_factor, power_map
from radard.dsp.clutter import block_power, sound_rows
from tests.clutter_helpers import ALL, AXIS, body, db
from tests.radar_helpers import dwell_of, noise, walker

TIME_S = (np.arange(147) + 0.5) / 60


def chart_of(frames, *, valid=ALL, floor=1.0, axis=AXIS):
    how = {"frame_rate_hz": 60.0, "end_s": 2.45, "floor": np.full(axis.n_range, floor)}
    return power_map(np.asarray(frames, np.complex64), valid, axis, **how)


def map_of(ratio, n_looks=7.0):
    n_block, n_cell = ratio.shape
    return PowerMap(ratio, np.arange(n_block) * 0.12, np.arange(n_cell) * 0.03, 0.03, n_looks)


def test_map_of_noise_is_one_everywhere():
    chart = chart_of(noise(147, 96))
    assert chart.ratio.shape == (20, 96)
    assert chart.ratio.mean() == pytest.approx(1, abs=0.02)
    # 140 of 147 frames in five CPIs of four blocks of seven, aligned to the end.
    np.testing.assert_allclose(chart.time_s, 2.45 - (140 - 7 * np.arange(20) - 3.5) / 60)
    assert chart.n_looks == 7
    np.testing.assert_allclose(chart.range_m, AXIS.range_m)
    # Fine bins are put together to cells.
    axis = replace(AXIS, n_range=770, bin_length_m=0.0293 / 8)
    chart = chart_of(noise(147, 770), axis=axis)
    assert chart.ratio.shape[1] == 86
    assert chart.cell_m == pytest.approx(9 * 0.0293 / 8)
    assert chart.ratio.mean() == pytest.approx(1, abs=0.02)
    assert chart.range_m[0] == pytest.approx(0.6 + 4 * 0.0293 / 8)
    assert chart.range_m[-1] == pytest.approx(axis.range_m[[765, 769]].mean())
    assert chart_of(noise(147, 96), axis=replace(AXIS, bandwidth_hz=0)).ratio.shape[1] == 96


def test_lost_frames_and_dead_bins_give_zero():
    frames = noise(147, 96)
    frames[7:14] = np.nan
    frames[40:60] = 1e6
    valid = ALL.copy()
    valid[40:60] = False
    chart = chart_of(frames, valid=valid)
    # The second CPI has too few frames left, the first one lost a block.
    assert len(chart.ratio) == 16
    assert not chart.ratio[0].any()
    assert chart.ratio[1:].mean() == pytest.approx(1, abs=0.05)
    dead = chart_of(noise(147, 96), floor=0.0)
    assert not dead.ratio.any()
    assert find_peaks(dead, 9) == [[] for _ in range(20)]


@pytest.mark.parametrize("n_looks", [1.0, 3.5, 7.0])
@pytest.mark.parametrize(("n", "k"), [(16, 6), (8, 3), (30, 22)])
def test_factors_keep_the_false_alarm_rate(n, k, n_looks):
    rng, alarm = np.random.default_rng(6), 1e-2
    cells = rng.gamma(n_looks, size=(100_000, n + 1))
    level = np.partition(cells[:, 1:], k, axis=1)[:, k]
    rate = np.mean(cells[:, 0] > os_factor(n, k, n_looks, alarm) * level)
    assert rate == pytest.approx(alarm, rel=0.12)
    rate = np.mean(cells[:, 0] / n_looks > floor_factor(n_looks, alarm))
    assert rate == pytest.approx(alarm, rel=0.12)
    # Of one look they are known in closed form: Rohling's product, and an exponential.
    i = np.arange(k + 1)
    assert np.prod((n - i) / (n - i + os_factor(n, k, 1.0, 1e-3))) == pytest.approx(1e-3, rel=0.01)
    assert floor_factor(1.0, 1e-3) == pytest.approx(-np.log(1e-3))


def test_neither_noise_nor_the_fill_behind_a_body_gives_peaks():
    found = 0
    for seed in range(30):
        found += sum(map(len, find_peaks(chart_of(noise(147, 96, seed=seed)), 0.0)))
    assert found <= 30 * 20 * 96 * FALSE_ALARM * 3
    ratio = np.random.default_rng(9).gamma(2.0, size=(40, 96)) / 2
    ratio[:, 30:] *= 10**2
    ratio[:, 29:33] = 10**4
    peaks = find_peaks(map_of(ratio), 9)
    assert sum(len(p) for p in peaks) <= 44
    assert all(any(abs(q.range_m - 0.91) < 0.1 for q in p) for p in peaks)


@pytest.mark.parametrize("level", [5, 20, 60])
def test_a_body_gives_one_peak_a_block_where_it_is(level):
    chart = chart_of(noise(147, 96) + body(2.8 - 0.6 * TIME_S, level + 10))
    peaks = find_peaks(chart, 9)
    assert np.mean([len(p) == 1 for p in peaks]) >= 0.9
    for time_s, found in zip(chart.time_s, peaks, strict=True):
        for peak in found:
            assert peak.range_m == pytest.approx(2.8 - 0.6 * time_s, abs=0.05)
            assert peak.power_db == pytest.approx(level + 10, abs=3)


def test_equal_cells_and_tiny_maps_give_no_peak():
    assert find_peaks(map_of(np.full((2, 96), 100.0)), 9) == [[], []]
    assert find_peaks(map_of(np.zeros((2, 1))), 9) == [[], []]
    assert find_peaks(map_of(np.zeros((0, 96))), 9) == []
    alone = find_peaks(map_of(np.full((1, 1), 100.0)), 9)
    assert [p.power_db for p in alone[0]] == [pytest.approx(db(100))]
    # At most eight, the strongest first.
    ratio = np.ones((1, 400))
    ratio[0, 20::38] = 1e4 * np.arange(1, 11)
    (found,) = find_peaks(map_of(ratio), 9)
    assert len(found) == 8
    assert [p.power_db for p in found] == sorted((p.power_db for p in found), reverse=True)


@pytest.mark.parametrize("unit", [1e-40, 1e-20, 1.0, 1e15, 1e30])
@pytest.mark.parametrize("clutter_db", [0, 60, 80])
def test_map_against_float64(unit, clutter_db):
    frames = (noise(84, 96) + 10 ** (clutter_db / 20) * noise(1, 96, seed=3)).astype(np.complex64)
    frames = (frames.astype(np.complex128) * unit).astype(np.complex64)
    chart = chart_of(frames, valid=ALL[:84], floor=unit**2)
    y = frames.astype(np.complex128) / unit
    cpis = y.reshape(3, 28, 96)
    power = np.abs(cpis - cpis.mean(axis=1, keepdims=True)) ** 2 * 28 / 27
    wanted = power.reshape(12, 7, 96).mean(axis=1)
    assert chart.ratio.shape == wanted.shape
    assert np.linalg.norm(chart.ratio - wanted) < 1e-5 * np.linalg.norm(wanted)


N_CPI = 28


def peaks_of(frames, lost=()):
    usable = np.ones(len(frames), np.bool_)
    usable[list(lost)] = False
    rows, usable, scale = sound_rows(frames, usable)
    peak, residue, power = cfar.doppler_peaks(rows, usable, N_CPI)
    assert power == pytest.approx(block_power(rows, usable, N_CPI, 1)[0][:, 0], rel=1e-4, abs=1e-9)
    return peak * scale**2, residue * scale**2


@pytest.mark.parametrize("sigma", [1e-12, 1.0, 1e9])
def test_of_white_noise_residue_is_its_power_and_peaks_are_as_usual(sigma):
    found = [peaks_of(noise(147, seed=k, sigma=sigma)) for k in range(20)]
    assert np.mean([r for _, r in found]) == pytest.approx(sigma**2, rel=0.02)
    peak = np.array([p for p, _ in found])
    assert peak.shape == (20, 5, 64)
    assert peak.mean() == pytest.approx(cfar.usual_peak(N_CPI) * sigma**2, rel=0.02)


def test_a_line_is_as_strong_as_its_gain_says_and_what_stands_still_is_in_no_cell():
    turns = np.exp(2j * np.pi * 5 * np.arange(140) / N_CPI)[:, None] * np.ones(64)
    peak, residue = peaks_of(turns.astype(np.complex64))
    # All of its power in one of three cells.
    assert peak == pytest.approx(np.full((5, 64), N_CPI / 3), rel=1e-4)
    assert residue == pytest.approx(np.zeros(64), abs=1e-9)
    # A lost frame makes none either.
    frames = np.full((147, 64), 1e4 + 5e3j, np.complex64)
    frames[60] = 0
    peak, _ = peaks_of(frames, lost=[60])
    assert not peak.any()
    # Without a usable cpi there is nothing.
    peak, residue = peaks_of(noise(147), lost=range(147))
    assert peak.shape == (0, 64)
    assert not residue.any()


@pytest.mark.parametrize(
    ("excess", "reached"),
    [
        ([], (0.0, 0)),
        ([3.0], (3.0, 0)),
        ([3.0, 2.0], (2.0, 1)),
        ([3.0, 0.5, 2.0, 0.5, 0.5], (2.0, 2)),
        ([3.0, 0.5, 0.6, 4.0, 0.5], (0.6, 2)),
        ([0.5, 0.5, cfar.ALONE, 0.5, 0.5], (cfar.ALONE, 2)),
    ],
)
def test_two_of_three(excess, reached):
    assert cfar.two_of_three(np.array(excess)) == reached


@pytest.mark.parametrize(("n_cpis", "n_cpi", "n_range"), [(5, 28, 96), (4, 8, 180), (2, 28, 64)])
def test_the_factor_falls_with_the_rate(n_cpis, n_cpi, n_range):
    factors = [cfar.cell_factor(share, n_cpis, n_cpi, n_range) for share in (1e-8, 1e-5, 1e-2, 1)]
    assert factors == sorted(factors, reverse=True)
    assert factors[-1] < 1e-2


def test_noise_opens_no_more_often_than_stated():
    # So often that it can be counted: at most 100 of 1000 dwells.
    gate = Gate(GateSettings(false_alarms_per_day=0.1 * DAY_S))
    opened = sum(gate.read(dwell_of(noise(147, seed=k))).is_open for k in range(1000))
    # The bound counts overlapping sums as independent: a quarter or more of it is reached.
    assert 25 <= opened <= 100


@pytest.mark.parametrize(("speed_mps", "snr_db"), [(0.1, 3), (0.3, 3), (0.9, 8), (2.0, 12)])
def test_a_point_weaker_than_the_gate_of_before_needed_opens(speed_mps, snr_db):
    # Who crosses several bins within a CPI needs more; the mean power needed 13 dB.
    opened = 0
    for k in range(20):
        gate = Gate(GateSettings())
        start_m = 0.7 + min(1.8, 2.4 * speed_mps)
        point = walker(147, 60, speed_mps=speed_mps, start_m=start_m, level=10 ** (snr_db / 20))
        gate.read(dwell_of(noise(147, seed=2 * k)))
        frames = noise(147, seed=2 * k + 1) + point
        opened += gate.read(dwell_of(frames.astype(np.complex64))).is_open
    assert opened >= 15


def test_residue_of_jitter_opens_nothing_and_a_body_does_not_hide_itself():
    weak, strong = Gate(GateSettings()), Gate(GateSettings())
    for k in range(40):
        white = noise(147, seed=100 + k)
        frames = noise(147, seed=k)
        frames[:, 20] += 0.95 * (cfar.MAX_RESIDUE - 1) ** 0.5 * white[:, 20]
        assert not weak.read(dwell_of(frames)).is_open
        frames[:, 20:26] += 6 * white[:, 20:26]
        assert strong.read(dwell_of(frames)).is_open or k >= 20
    # A short burst opens nothing and who rushes past does.
    burst = noise(147, seed=1)
    burst[60:63] *= 10
    assert not Gate(GateSettings()).read(dwell_of(burst)).is_open
    rush = noise(147, seed=2)
    rush[126:] += walker(21, 60, speed_mps=2.0, start_m=2.0, level=30)
    assert Gate(GateSettings()).read(dwell_of(rush)).is_open
