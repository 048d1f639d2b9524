import numpy as np
import pytest

from radard.dsp.clutter import centre_spread_m, noise_power, residual_power
from radard.errors import FeatureError
from radard.gate import Gate, GateSettings
from tests.radar_helpers import dwell_of, noise, walker

ALL = np.ones(147, np.bool_)


def db(power):
    return 10 * np.log10(power)


@pytest.mark.parametrize("sigma", [1e-18, 1e-3, 1.0, 1e3])
def test_residual_and_noise_of_pure_noise_are_unbiased(sigma):
    frames = noise(147, 768, sigma=sigma)
    scaled = (frames / np.abs(frames).max()).astype(np.complex64)
    scale = float(np.abs(frames).max()) ** 2
    assert db(residual_power(scaled, ALL, 28).mean() * scale) == pytest.approx(
        db(sigma**2), abs=0.1
    )
    assert db(noise_power(scaled, ALL) * scale) == pytest.approx(db(sigma**2), abs=0.3)


def test_static_clutter_leaves_nothing():
    frames = noise(147, 64) + noise(1, 64, seed=9, sigma=1e3)
    assert db(residual_power(frames.astype(np.complex64), ALL, 28).mean()) == pytest.approx(
        0, abs=0.3
    )


def test_lost_frames_are_left_out():
    frames = noise(147, 64)
    frames[100] = 1e6
    valid = ALL.copy()
    valid[100] = False
    assert db(residual_power(frames, valid, 28).mean()) == pytest.approx(0, abs=0.3)
    assert db(noise_power(frames, valid)) == pytest.approx(0, abs=0.5)
    none = np.zeros(147, np.bool_)
    assert len(residual_power(frames, none, 28)) == 0
    assert np.isnan(noise_power(frames, none))


def test_residual_refuses_a_short_record():
    with pytest.raises(FeatureError):
        residual_power(noise(10), np.ones(10, np.bool_), 28)


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e9])
def test_opens_for_a_walker_from_the_first_dwell_in_any_unit(unit):
    gate = Gate(GateSettings())
    quiet = Gate(GateSettings())
    for k in range(40):
        here = noise(147, seed=k)
        moving = here + walker(147, 60, speed_mps=0.5, start_m=2.2, level=20)
        assert gate.read(dwell_of((moving * unit).astype(np.complex64))).is_open is True
        reading = quiet.read(dwell_of((here * unit).astype(np.complex64)))
        assert reading.is_open is False
        assert reading.power_db == pytest.approx(db(unit**2), abs=0.5)
        assert reading.threshold_db - reading.noise_floor_db == pytest.approx(6, abs=0.5)


def test_range_is_where_the_walker_is():
    frames = noise(147) + walker(147, 60, speed_mps=0.1, start_m=1.9, level=30)
    reading = Gate(GateSettings()).read(dwell_of(frames.astype(np.complex64)))
    assert reading.range_m == pytest.approx(1.8, abs=0.15)


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
    assert readings[-1].noise_floor_db > readings[0].noise_floor_db + 5
    walk = walker(147, 60, speed_mps=0.5, start_m=2.2, level=20)
    assert gate.read(dwell_of(noise(147, seed=99) + corner() + walk)).is_open
    gate.reset()
    assert gate.read(dwell_of(noise(147, seed=100) + corner())).is_open


def test_never_learns_what_is_far_over_the_noise():
    gate = Gate(GateSettings(adapt_db=20))
    rng = np.random.default_rng(3)
    for k in range(60):
        frames = noise(147, seed=k)
        frames[:, 5] += 1000 * np.exp(0.5j * rng.standard_normal(147))
        assert gate.read(dwell_of(frames)).is_open


def test_spread_of_the_centre():
    power = np.full((4, 10), 1.0)
    range_m = np.arange(10.0)
    assert centre_spread_m(power, 1.0, range_m) == 0
    power[:, 3] = 100
    assert centre_spread_m(power, 1.0, range_m) == 0
    power[2, 3], power[2, 7] = 1, 50
    assert centre_spread_m(power, 1.0, range_m) == pytest.approx(4)
    power[2, 7] = 8  # too weak beside the others to count
    assert centre_spread_m(power, 1.0, range_m) == 0


@pytest.mark.parametrize("value", [0.0, 5.0])
def test_a_dead_receiver_is_closed_and_finite(value):
    reading = Gate(GateSettings()).read(dwell_of(np.full((147, 64), value, np.complex64)))
    assert reading.is_open is False
    assert np.isfinite([reading.power_db, reading.noise_floor_db, reading.threshold_db]).all()
