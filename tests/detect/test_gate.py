"""The gate and its calibration: what opens it, and where its rules begin and end."""

import json
from dataclasses import replace

import numpy as np
import pytest

from radard.config.sections import GateSettings
from radard.detect.calibration import load_calibration
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import Gate, NoiseFloor, level_over
from radard.dsp.cfar import MAX_RESIDUE, cell_factor, usual_peak
from radard.dsp.clutter import centre_spread_m, second_differences, sound_rows
from radard.errors import ConfigError
from tests.clutter_helpers import (
    AXIS,
    DATA,
    calibration,
    db,
    dwells_of_recording,
    needs_data,
    room,
)
from tests.radar_helpers import BASEBAND, dwell_of, noise, walker


@pytest.mark.parametrize("unit", [1e-38, 1e-12, 1.0, 1e9, 1e30])
def test_opens_for_a_walker_from_the_first_dwell_in_any_unit(unit):
    gate = Gate(GateSettings())
    quiet = Gate(GateSettings())
    for k in range(40):
        here = noise(147, seed=k)
        moving = here + walker(147, 60, speed_mps=0.5, start_m=2.2, level=20)
        assert gate.read(dwell_of((moving * unit).astype(np.complex64))).is_open is True
        reading = quiet.read(dwell_of((here * unit).astype(np.complex64)))
        assert reading.is_open is False
        # The strongest of some thousand cells of noise, and what noise reaches once in 100 days.
        assert reading.power_db == pytest.approx(db(unit**2) + 6, abs=1.5)
        assert reading.noise_floor_db == pytest.approx(db(unit**2), abs=1)
        assert reading.threshold_db - reading.noise_floor_db == pytest.approx(8.7, abs=0.1)


@pytest.mark.parametrize("n_range", [64, 180, 400])
def test_the_length_of_the_swath_does_not_hide_a_weak_body(n_range):
    gate = Gate(GateSettings())
    rng = np.random.default_rng(1)
    body = np.zeros((147, n_range))
    # 13 dB over the noise in four bins: 3.5 dB over it in the mean of 64.
    body[:, 40:44] = np.sqrt(20)
    turning = np.exp(1j * np.cumsum(rng.standard_normal(147)))[:, None]
    for k in range(5):
        quiet = noise(147, n_range, seed=k)
        assert gate.read(dwell_of(quiet, axis=AXIS, end=147 + 60 * k)).is_open is False
    moving = (quiet + body * turning).astype(np.complex64)
    reading = gate.read(dwell_of(moving, axis=AXIS, end=447))
    assert reading.is_open is True
    assert reading.power_db > reading.threshold_db
    assert reading.range_m == pytest.approx(AXIS.range_m[41], abs=0.1)


def test_learns_a_fidgeting_corner_but_not_who_walks_through_it():
    gate = Gate(GateSettings())
    rng = np.random.default_rng(3)

    def corner():
        frames = np.zeros((147, 64), np.complex64)
        frames[:, 5] = 80 * np.exp(0.5j * rng.standard_normal(147))
        return frames

    readings = [gate.read(dwell_of(noise(147, seed=k) + corner())) for k in range(30)]
    assert all(r.is_open for r in readings[:20])
    assert not any(r.is_open for r in readings[20:])
    assert db(gate.background[5]) > 5
    assert gate.level[5] > 5
    assert np.delete(gate.level, 5).max() < 1.5
    walk = walker(147, 60, speed_mps=0.5, start_m=2.2, level=20)
    assert gate.read(dwell_of(noise(147, seed=99) + corner() + walk)).is_open


@pytest.mark.parametrize("steps", [(1.0, 4.0), (4.0, 1.0), (1.0, 16.0)])
def test_noise_that_differs_over_range_is_floor_from_the_first_dwell(steps):
    gate = Gate(GateSettings())
    level = np.repeat(np.sqrt(steps), 32)
    for k in range(10):
        reading = gate.read(dwell_of((noise(147, seed=k) * level).astype(np.complex64)))
        assert reading.is_open is False
        assert db(gate.background.mean()) == pytest.approx(db(np.mean(steps)), abs=0.7)
    walk = walker(147, 60, speed_mps=0.5, start_m=2.2, level=20 * max(level))
    frames = noise(147, seed=50) * level + walk
    assert gate.read(dwell_of(frames.astype(np.complex64))).is_open


def test_a_body_does_not_become_floor():
    gate = Gate(GateSettings())
    for k in range(15):
        turning = 30 * np.exp(0.3j * np.cumsum(np.random.default_rng(k).standard_normal(147)))
        frames = noise(147, seed=k)
        frames[:, 20:28] += turning[:, None] * np.linspace(0.2, 1, 147)[:, None]
        gate.read(dwell_of(frames.astype(np.complex64)))
    assert gate.background[20:28].max() < 2


def test_calibration_takes_the_place_of_floor_and_threshold_and_survives_its_file(tmp_path):
    gate = Gate(GateSettings(), calibration=calibration(floor=100.0))
    reading = gate.read(dwell_of(noise(147)))
    assert reading.noise_floor_db == pytest.approx(20)
    assert not reading.is_open
    gate = Gate(GateSettings(), calibration=calibration(floor=0.01))
    reading = gate.read(dwell_of(noise(147)))
    # Of what is over the calibrated floor, as much again may be clutter's residue.
    assert reading.threshold_db == pytest.approx(db(2 * 0.01 * 10), abs=0.1)
    assert reading.is_open
    made = calibration(floor=1e-6)
    made.floor[3] = 0
    made.threshold_db[5] = 7.25
    made.save(tmp_path / "c.json")
    back = load_calibration(tmp_path / "c.json")
    np.testing.assert_allclose(back.floor, made.floor, rtol=3e-4)
    assert back.floor[3] == 0
    np.testing.assert_array_equal(back.threshold_db, made.threshold_db)
    back.check(BASEBAND, 60.0)


@pytest.mark.parametrize(
    ("axis", "rate_hz", "word"),
    [
        (BASEBAND, 30.0, "frame_rate_hz is 60"),
        (replace(BASEBAND, bin_length_m=0.1), 60.0, "bin_length_m"),
        (replace(BASEBAND, range_offset_m=1.0), 60.0, "range_offset_m"),
        (replace(BASEBAND, n_range=96), 60.0, "number of bins is 64"),
    ],
)
def test_calibration_of_another_stream_is_refused(axis, rate_hz, word):
    with pytest.raises(ConfigError, match=word):
        calibration().check(axis, rate_hz)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"format": "other"}, "format: input should be 'radard-calibration'"),
        ({"format_version": 1}, "format_version: input should be 2 .got 1.; calibrate again"),
        ({"format_version": 3}, "format_version"),
        ({"frame_rate_hz": "60"}, "frame_rate_hz"),
        ({"bin_length_m": True}, "bin_length_m"),
        ({"noise_floor_db": []}, "noise_floor_db"),
        ({"noise_floor_db": [1.0, "x"]}, "noise_floor_db"),
        ({"threshold_db": [None, 6.0]}, "threshold_db"),
        ({"threshold_db": [6.0]}, "1 values for 2"),
        ({"threshold_db": [6.0, -1.0]}, "threshold_db.1: .*greater than or equal to 0"),
        ({"frame_rate_hz": 10**400}, "frame_rate_hz"),
        ({"bin_length_m": json.loads("[" * 900 + "]" * 900)}, "recursion limit"),
        ({"noise_floor_db": [1e300, None]}, "noise_floor_db"),
        ({"provenance": 9}, "provenance"),
        *(
            ({"provenance": {"made_utc": when}}, "provenance.made_utc")
            for when in ("9" * 5000, "9999-99-99")
        ),
    ],
)
def test_wrong_calibration_files_name_their_fault(change, word, tmp_path):
    content = {
        "format": "radard-calibration",
        "format_version": 2,
        "frame_rate_hz": 60.0,
        "bin_length_m": 0.03,
        "range_offset_m": 0.6,
        "noise_floor_db": [-30.0, None],
        "threshold_db": [6.0, 6.0],
    }
    path = tmp_path / "c.json"
    path.write_text(json.dumps(content))
    assert load_calibration(path).floor.tolist() == pytest.approx([1e-3, 0])
    path.write_text(json.dumps(content | change))
    with pytest.raises(ConfigError, match=word) as caught:
        load_calibration(path)
    assert len(str(caught.value)) < 1000


def test_jitter_of_strong_clutter_opens_the_gate_unless_it_is_removed():
    bare, clean, remover = Gate(GateSettings()), Gate(GateSettings()), ClutterRemover()
    for k in range(10):
        dwell = dwell_of(room(seed=k, peak_db=66), axis=AXIS, end=147 + 60 * k)
        assert bare.read(dwell).is_open
        assert not clean.read(remover.remove(dwell)).is_open


def readings(path, step=1):
    """What the gate says of a recording: stream times and whether it is open."""
    gate = Gate(GateSettings())
    dwells = dwells_of_recording(path, step)
    return np.array([(dwell.t_s, gate.read(dwell).is_open) for dwell in dwells]).T


@needs_data
@pytest.mark.parametrize("name", ["101", "102"])
def test_real_walks_open_the_gate_all_the_time(name):
    time_s, is_open = readings(DATA / f"p410_walk_{name}.mat", step=4)
    # Then the walker stands, still in sight, and is seen on and off.
    assert is_open[time_s < 31].all()


N_CPI = 28  # frames of a CPI at 60 Hz
N_RANGE = BASEBAND.n_range


def swing(power, *, turns=1, n_cpis=5):
    """Motion that every CPI shows alike: each bin turns so often in one, with this power.

    Its mean over a CPI is zero, so clutter removal takes the mean of none and counts one
    frame less.
    """
    amplitude = np.sqrt(np.asarray(power, np.float64) * (N_CPI - 1) / N_CPI)
    turning = np.exp(2j * np.pi * turns * np.arange(N_CPI) / N_CPI)
    return np.tile(turning[:, None] * amplitude, (n_cpis, 1)).astype(np.complex64)


def calibrated(settings, floor, *, hop_s=1.0, threshold_db=10.0):
    """A gate whose floors are these, whatever the stream shows."""
    return Gate(settings, hop_s, calibration(floor, threshold_db))


def in_bins(bins, power):
    """Power of every bin: `power` in some, nothing elsewhere."""
    powers = np.zeros(N_RANGE)
    powers[bins] = power
    return powers


def at_once(**changes):
    """Settings that learn from one dwell and forget it after the next."""
    return GateSettings(memory_s=1, learn_s=1, **changes)


def test_before_the_first_dwell_nothing_is_known():
    gate = Gate(GateSettings())
    of_bins = (gate.background, gate.power, gate.noise, gate.floor, gate.residue, gate.level)
    assert [each.shape for each in of_bins] == [(0,)] * 6
    assert gate.cpi_power.shape == gate.cell_peak.shape == (0, 0)
    # Four frames are a cpi where frames are slow.
    gate = Gate(GateSettings())
    gate.read(dwell_of(noise(24), rate_hz=8.0))
    assert gate.cpi_power.shape == gate.cell_peak.shape == (6, N_RANGE)


@pytest.mark.parametrize("hop_s", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("per_day", [0.01, 3.0])
def test_the_threshold_is_that_of_the_false_alarms_a_day(per_day, hop_s):
    gate = Gate(GateSettings(false_alarms_per_day=per_day), hop_s)
    reading = gate.read(dwell_of(noise(147)))
    dwells_a_day = 24 * 60 * 60 / hop_s
    factor = cell_factor(per_day / dwells_a_day, 5, N_CPI, N_RANGE)
    assert reading.threshold_db - reading.noise_floor_db == pytest.approx(db(factor), abs=1e-9)


def test_a_floor_moves_by_its_rate_in_time_whatever_the_hop():
    moved_db = []
    for hop_s in (0.5, 2.0):
        gate = Gate(GateSettings(floor_rate_db_per_s=0.1), hop_s)
        for k in range(5):
            frames = noise(147, seed=k)
            frames[:, :24] *= 10 if k else 1
            gate.read(dwell_of(frames))
            if k == 0:
                before = gate.floor[:8].mean() / gate.floor[40:].mean()
        moved_db.append(db(gate.floor[:8].mean() / gate.floor[40:].mean() / before))
    # Of the two ends, one goes up by the rate and the other one down.
    assert moved_db[0] == pytest.approx(2 * 0.1 * 4 * 0.5, rel=0.05)
    assert moved_db[1] == pytest.approx(2 * 0.1 * 4 * 2.0, rel=0.05)


@pytest.mark.parametrize(
    ("n_bins", "over_db", "is_learned"),
    [(48, 20.0, True), (49, 20.0, False), (49, 4.9, True), (49, 5.1, False)],
)
@pytest.mark.parametrize("floor", [1.0, 100.0])
def test_motion_in_more_than_three_quarters_of_the_swath_is_not_learned(
    n_bins, over_db, is_learned, floor
):
    """A bin counts as moving from 5 dB over its floor on."""
    gate = calibrated(at_once(adapt_db=60), floor)
    powers = in_bins(slice(n_bins), floor * 10 ** (over_db / 10))
    # Of the stream's noise, a million times as much may be learned.
    dwell = dwell_of(swing(powers) + noise(140, sigma=0.01 * np.sqrt(floor)))
    gate.read(dwell)
    gate.read(dwell)
    is_higher = gate.background > 1.5 * floor
    assert np.count_nonzero(is_higher) == (n_bins if is_learned else 0)


def test_bins_without_a_signal_do_not_count_as_moving():
    gate = Gate(at_once())
    frames = np.zeros((140, N_RANGE), np.complex64)
    frames[:, 7:12] = noise(140)[:, 7:12]
    frames[:, 9] += swing(100.0 * np.ones(N_RANGE))[:, 9]
    gate.read(dwell_of(frames))
    gate.read(dwell_of(frames))
    assert gate.level[9] > 10 * gate.floor[9]


def test_motion_that_wanders_as_far_as_the_limit_is_not_in_place():
    frames = noise(140)
    for cpi in range(5):
        rows = slice(cpi * N_CPI, (cpi + 1) * N_CPI)
        frames[rows] += swing(in_bins(slice(20 + cpi, 24 + cpi), 400.0))[rows]
    dwell = dwell_of(frames)
    rows, usable, scale = sound_rows(dwell.frames, dwell.valid)
    probe = Gate(at_once())
    probe.read(dwell)
    level, _ = NoiseFloor(1, 0.5).update(
        second_differences(rows, usable), probe.cpi_power / scale**2, N_CPI, scale**2
    )
    spread_m = centre_spread_m(probe.cpi_power, level, BASEBAND.range_m)
    assert 0.05 < spread_m < 0.2
    for limit_m, is_learned in ((spread_m, False), (spread_m + 1e-9, True)):
        gate = Gate(at_once(in_place_m=limit_m))
        gate.read(dwell)
        gate.read(dwell)
        assert (gate.level[22] > 10 * gate.floor[22]) is np.bool_(is_learned)


def test_a_dwell_of_one_cpi_is_learned_and_one_without_is_not():
    gate = calibrated(at_once(), 1.0)
    short = dwell_of(noise(N_CPI, sigma=1.0) + swing(in_bins([20], 100.0), n_cpis=1))
    gate.read(short)
    gate.read(short)
    assert gate.background[20] > 50
    gate.read(dwell_of(noise(140), lost=range(140)))
    gate.read(dwell_of(noise(140)))
    assert np.array_equal(gate.background, np.ones(N_RANGE))


@pytest.mark.parametrize(("memory_s", "n_kept"), [(1, 0), (5, 4), (10, 9)])
def test_what_was_learned_is_kept_as_long_as_it_is_remembered(memory_s, n_kept):
    """In seconds of stream time; dwells here come every half second, or every second for one."""
    hop_s = 0.5 if memory_s > 1 else 1.0
    gate = calibrated(GateSettings(memory_s=memory_s, learn_s=1), 1.0, hop_s=hop_s)
    corner = dwell_of(swing(in_bins([20], 100.0)) + noise(140))
    everywhere = dwell_of(swing(np.full(N_RANGE, 100.0)) + noise(140))
    n_memory = round(memory_s / hop_s)
    for _ in range(n_memory):
        gate.read(corner)
    n_learn = round(1 / hop_s)
    learned = []
    for _ in range(n_memory + 2):
        gate.read(everywhere)
        learned.append(bool(gate.background[20] > 50))
    # The first of them finds all the memory full; then one dwell less each.
    assert learned.index(False) == n_memory - n_learn + 1
    assert not any(learned[learned.index(False) :])


@pytest.mark.parametrize(("learn_s", "hop_s", "n_learn"), [(1, 1.0, 1), (3, 0.5, 6), (4, 2.0, 2)])
def test_motion_in_place_is_background_after_the_time_to_learn(learn_s, hop_s, n_learn):
    gate = calibrated(GateSettings(learn_s=learn_s, memory_s=30), 1.0, hop_s=hop_s)
    corner = dwell_of(swing(in_bins([20], 100.0)) + noise(140))
    learned = []
    for _ in range(n_learn + 2):
        gate.read(corner)
        learned.append(bool(gate.background[20] > 50))
    assert learned.index(True) == n_learn


@pytest.mark.parametrize("adapt_db", [20.0, 40.0])
def test_no_more_is_learned_than_the_setting_allows_over_the_noise(adapt_db):
    gate = Gate(at_once(adapt_db=adapt_db))
    dwell = dwell_of(swing(in_bins([5], 1e6)) + noise(140))
    gate.read(dwell)
    gate.read(dwell)
    # The level in memory is common to the swath; a bin's own noise is off by the draw.
    assert db(gate.background[5] / np.median(gate.noise)) == pytest.approx(adapt_db, abs=0.5)


@pytest.mark.parametrize("adapt_db", [60.0, 10.0])
def test_learned_motion_must_be_exceeded_five_times(adapt_db):
    gate = Gate(at_once(adapt_db=adapt_db))
    dwell = dwell_of(swing(in_bins([5], 300.0)) + noise(140))
    gate.read(dwell)
    power, peak = gate.power[5], gate.cell_peak[:, 5].mean()
    gate.read(dwell)
    # What is learned is bounded by its power: of that, noise has its share.
    share = gate.background[5] / power
    assert share == pytest.approx(1) if adapt_db == 60 else share < 0.1
    learned = peak / usual_peak(N_CPI) * share
    assert gate.level[5] == pytest.approx(5 * (learned - gate.floor[5]), rel=1e-9)


def test_clutter_may_raise_a_level_to_twice_the_noise_of_a_bin_or_its_neighbours():
    floor = np.array([1.0, 5.0, 1.0, 1.0, 2.0, 7.0])
    much = level_over(floor, np.full(6, 100.0))
    np.testing.assert_array_equal(much, MAX_RESIDUE * np.array([5.0, 5, 5, 2, 7, 7]))
    np.testing.assert_array_equal(level_over(floor, np.zeros(6)), floor)
    between = level_over(floor, np.full(6, 3.0))
    np.testing.assert_array_equal(between, [3.0, 5, 3, 3, 3, 7])
    steps = level_over(np.array([9.0, 1, 1, 9]), np.full(4, 100.0))
    np.testing.assert_array_equal(steps, MAX_RESIDUE * np.full(4, 9.0))


@pytest.mark.parametrize(("share", "is_open"), [(1.0, False), (0.7, True)])
def test_power_must_exceed_the_threshold_not_reach_it(share, is_open):
    dwell = dwell_of(swing(in_bins([20], 100.0)))
    probe = Gate(GateSettings())
    probe.read(dwell)
    (peak,) = set(probe.cell_peak[:, 20])
    reading = calibrated(GateSettings(), share * peak, threshold_db=0).read(dwell)
    assert reading.is_open is is_open
    assert (reading.power_db > reading.threshold_db) is is_open
    assert reading.power_db == db(peak)


def test_what_a_reading_tells():
    gate = calibrated(GateSettings(), 1.0, threshold_db=6.0)
    reading = gate.read(dwell_of(noise(140, sigma=0.1)))
    assert reading.noise_floor_db == 0
    assert reading.threshold_db == pytest.approx(6)
    # Over a floor of nothing any power opens.
    gate = calibrated(GateSettings(), np.where(np.arange(N_RANGE) == 20, 0.0, 1.0))
    # Transforms of four frames are exact: nothing but the motion is in any cell.
    turning = np.tile(np.array([1, 1j, -1, -1j]), 6)[:, None]
    frames = (turning * in_bins([20], 2.0**-10)).astype(np.complex64)
    reading = gate.read(dwell_of(frames, rate_hz=8.0))
    assert gate.level[20] == 0
    assert reading.is_open is True
    assert reading.range_m == BASEBAND.range_m[20]
    # Bins without a signal never stand out.
    frames = np.zeros((140, N_RANGE), np.complex64)
    frames[:, 7] = noise(140)[:, 7]
    reading = Gate(GateSettings()).read(dwell_of(frames))
    assert reading.is_open is False
    assert reading.range_m == BASEBAND.range_m[7]
    assert np.isfinite(reading.power_db)
    assert reading.power_db > reading.noise_floor_db
    # Without a cpi the power is under any threshold.
    floor = np.linspace(1e-12, 2e-12, N_RANGE)
    reading = calibrated(GateSettings(), floor).read(dwell_of(noise(140), lost=range(140)))
    assert reading.is_open is False
    assert not reading.power_db > reading.threshold_db
    # The nearest bin stands for all of them.
    assert reading.range_m == BASEBAND.range_m[0]
    assert reading.noise_floor_db == pytest.approx(db(floor[0]))
    # The swath of the reading is that of the dwell.
    axis = replace(BASEBAND, range_offset_m=1.5)
    dwell = replace(dwell_of(swing(in_bins([20], 100.0)) + noise(140)), axis=axis)
    gate = Gate(GateSettings())
    assert gate.read(dwell).range_m == axis.range_m[20]
