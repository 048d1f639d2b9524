import numpy as np
import pytest

from radard.judge.display_db import WEAKEST_COLUMN_DB, shown


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
