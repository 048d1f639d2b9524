"""Detection on range-Doppler cells: its false-alarm rate, what it sees, what it does not."""

import numpy as np
import pytest

from radard.config.sections import GateSettings
from radard.detect.gate import DAY_S, Gate
from radard.dsp import range_doppler
from radard.dsp.clutter import block_power, sound_rows
from tests.radar_helpers import dwell_of, noise, walker

N_CPI = 28


def peaks_of(frames, lost=()):
    usable = np.ones(len(frames), np.bool_)
    usable[list(lost)] = False
    rows, usable, scale = sound_rows(frames, usable)
    peak, residue, power = range_doppler.doppler_peaks(rows, usable, N_CPI)
    assert power == pytest.approx(block_power(rows, usable, N_CPI, 1)[0][:, 0], rel=1e-4, abs=1e-9)
    return peak * scale**2, residue * scale**2


@pytest.mark.parametrize("sigma", [1e-12, 1.0, 1e9])
def test_of_white_noise_residue_is_its_power_and_peaks_are_as_usual(sigma):
    found = [peaks_of(noise(147, seed=k, sigma=sigma)) for k in range(20)]
    assert np.mean([r for _, r in found]) == pytest.approx(sigma**2, rel=0.02)
    peak = np.array([p for p, _ in found])
    assert peak.shape == (20, 5, 64)
    assert peak.mean() == pytest.approx(range_doppler.usual_peak(N_CPI) * sigma**2, rel=0.02)


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
        ([0.5, 0.5, range_doppler.ALONE, 0.5, 0.5], (range_doppler.ALONE, 2)),
    ],
)
def test_two_of_three(excess, reached):
    assert range_doppler.two_of_three(np.array(excess)) == reached


@pytest.mark.parametrize(("n_cpis", "n_cpi", "n_range"), [(5, 28, 96), (4, 8, 180), (2, 28, 64)])
def test_the_factor_falls_with_the_rate(n_cpis, n_cpi, n_range):
    factors = [
        range_doppler.cell_factor(share, n_cpis, n_cpi, n_range) for share in (1e-8, 1e-5, 1e-2, 1)
    ]
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
        frames[:, 20] += 0.95 * (range_doppler.MAX_RESIDUE - 1) ** 0.5 * white[:, 20]
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
