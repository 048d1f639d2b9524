"""Maps of range, Doppler and velocity: shapes, axes, CPIs of several lengths."""

from dataclasses import replace

import numpy as np
import pytest

from radard.judge.features import FeatureSettings, extract
from radard.judge.velocity_map import WEAKEST_COLUMN_DB, shown
from radard.stream.ring import Dwell
from tests.radar_helpers import BASEBAND, dwell_of, noise


def by_definition(power, valid, depth_db):
    """In extended precision, cell by cell."""
    p = power.astype(np.longdouble)
    top = p[:, valid].max()
    weakest = top * np.longdouble(10) ** (-WEAKEST_COLUMN_DB / 10)
    out = np.zeros(p.shape)
    for j in np.flatnonzero(valid):
        column = max(p[:, j].max(), weakest)
        for i in range(len(p)):
            if p[i, j] > 0:
                out[i, j] = np.clip(1 + 10 * np.log10(p[i, j] / column) / depth_db, 0, 1)
    return out


def exponential(seed=0, shape=(30, 12)):
    return np.random.default_rng(seed).exponential(size=shape) ** 3


@pytest.mark.parametrize("level", [1e-300, 1e-80, 1e-30, 1.0, 1e30, 1e80, 1e300])
@pytest.mark.parametrize("depth_db", [10.0, 25.0, 60.0])
def test_against_extended_precision_at_any_level(level, depth_db):
    power = exponential() * level
    valid = np.arange(12) % 5 != 3
    away = shown(power, valid, depth_db) - by_definition(power, valid, depth_db)
    assert np.abs(away).max() < 1e-6


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_stands_in_unknown_columns_does_not_matter(bad):
    power = exponential()
    valid = np.ones(12, np.bool_)
    valid[4] = False
    wanted = shown(power, valid, 25.0)
    power[:, 4] = bad
    assert np.array_equal(shown(power, valid, 25.0), wanted)
    assert not wanted[:, 4].any()


@pytest.mark.parametrize("power", [np.zeros((3, 4)), np.full((3, 4), np.inf), np.zeros((3, 0))])
def test_no_power_and_no_finite_power_show_nothing(power):
    picture = shown(power, np.ones(power.shape[1], np.bool_), 25.0)
    assert picture.shape == power.shape
    assert not picture.any()


SETTINGS = FeatureSettings(velocity_cpi_s=0.2, velocity_cpi_frames=6)
GRIDS = SETTINGS.velocity_grids()


def test_shapes_hold_the_columns_of_a_dwell_and_no_more():
    assert [GRIDS[name].shape for name in GRIDS] == [(101, 40), (61, 24), (81, 9)]
    dwell = dwell_of(noise(147))
    for name, made in extract(dwell, SETTINGS, tuple(GRIDS)).items():
        assert made.shape == GRIDS[name].shape
        assert made.any(axis=0).all()
    # A picture takes the newest columns.
    grid = GRIDS["velocity_time_long"]
    rng = np.random.default_rng(0)
    columns = rng.random((81, 40))
    valid = np.ones(40, np.bool_)
    whole = grid.picture(columns, valid, 10.0)
    assert np.array_equal(whole, grid.picture(columns[:, -12:], valid[-12:], 10.0))
    few = grid.picture(columns[:, -4:], valid[-4:], 10.0)
    assert not few[:, :5].any()
    assert few[:, 5:].any(axis=0).all()


@pytest.mark.parametrize("carrier_hz", [3.9e9, 6.8e9, 8.7e9])
@pytest.mark.parametrize("rate_hz", [15.0, 30.5, 60.0, 200.0])
def test_a_cpi_never_takes_more_than_three_quarters_of_a_dwell(carrier_hz, rate_hz):
    n_slow = round(2.0 * rate_hz) + round(28 / 60 * rate_hz) - 1
    axis = replace(BASEBAND, carrier_hz=carrier_hz)
    frames = noise(n_slow, axis.n_range)
    dwell = Dwell(frames, np.ones(n_slow, np.bool_), axis, rate_hz, n_slow / rate_hz)
    asked = replace(SETTINGS, velocity_cpi_carrier_hz=7e9)
    for name, grid in asked.velocity_grids().items():
        transform = grid.transform(dwell)
        assert transform.n_cpi <= max(0.75 * n_slow + 1, 6)
        wanted_s = max(grid.cpi_s * 7e9 / carrier_hz, 6 / rate_hz)
        if wanted_s < 0.75 * n_slow / rate_hz:
            assert transform.n_cpi == pytest.approx(wanted_s * rate_hz, abs=0.51)
        shown = extract(dwell, asked, (name,))[name]
        # What no whole CPI ends in stays empty; the newest cell is always there.
        assert shown[:, -1].any()
