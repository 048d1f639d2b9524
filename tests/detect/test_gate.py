import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from radard.config.sections import GateSettings
from radard.detect.calibration import load_calibration
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import Gate
from radard.errors import ConfigError
from tests.clutter_helpers import AXIS, calibration, db, dwells_of_recording, room
from tests.radar_helpers import BASEBAND, dwell_of, noise, walker

DATA = Path(__file__).parents[3] / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are not here")


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
    gate.reset()
    assert gate.read(dwell_of(noise(147, seed=100) + corner())).is_open


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
