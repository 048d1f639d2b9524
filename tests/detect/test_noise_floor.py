"""The noise of every bin as the gate learns it, against the same said bin by bin."""

import numpy as np
import pytest

from radard.detect.gate import NoiseFloor
from radard.dsp.clutter import noise_of, noise_profile

N_CPI = 28
MOST_DB = 0.5  # a dwell


def cells_of(rng, shape, n_rows=60):
    """Return squared second differences of noise with a mean of `shape` in each bin."""
    return (shape * rng.exponential(1.0, (n_rows, len(shape)))).astype(np.float32)


def window(k, n_range):
    """Return at most 25 bins, evenly spaced over a quarter of the swath about bin `k`."""
    half = n_range // 8
    step = next(step for step in range(1, n_range + 1) if 2 * half / step <= 24)
    found = []
    for offset in range(-(half // step) * step, half + 1, step):
        at = abs(k + offset)
        found.append(at if at <= n_range - 1 else 2 * (n_range - 1) - at)
    return found


def expected(levels, shape_db, cells, cpi_power, unit):
    """Return the level over dwells, the bins' noise and the next shape; `levels` grow."""
    here = noise_of(cells)
    if np.isfinite(here):
        levels.append(here * unit)
    level = min(levels[-3:], default=0.0)
    n_range = cells.shape[1]
    before = np.zeros(n_range) if shape_db is None else shape_db
    if here > 0 and len(cpi_power):
        own = np.maximum(noise_profile(cells), np.finfo(np.float32).tiny)
        most = 1 + 4 / np.sqrt(N_CPI - 1)
        stands = [
            all(own[k] / most < power < own[k] * most for power in cpi_power[:, k])
            for k in range(n_range)
        ]
        seen = [10 * np.log10(own[k] / here) if stands[k] else before[k] for k in range(n_range)]
        after = np.zeros(n_range)
        for k in range(n_range):
            members = sorted(seen[each] for each in window(k, n_range))
            step_db = members[(len(members) - 1) // 2] - before[k]
            if shape_db is not None:
                step_db = min(max(0.2 * step_db, -MOST_DB), MOST_DB)
            after[k] = min(max(before[k] + step_db, -10.0), 20.0)
        before = shape_db = after
    noise = [level * 10 ** (before[k] / 10) if cells[:, k].any() else 0.0 for k in range(n_range)]
    return level, noise, shape_db


@pytest.mark.parametrize("n_range", [1, 7, 16, 31, 64, 200, 213])
def test_level_and_shape_are_those_of_every_bin_by_itself(n_range):
    rng = np.random.default_rng(n_range)
    floor = NoiseFloor(3, MOST_DB)
    levels, shape_db = [], None
    tilts = (1.0, 30.0, 1e4, 1e-4, 1.0, 1.0, 1.0, 0.1)
    for turn, tilt in enumerate(tilts):
        shape = np.geomspace(1.0, tilt, n_range)
        if turn == 0:
            # Beyond what a shape may be, on both sides.
            shape[: n_range // 12], shape[n_range - n_range // 4 :] = 1e-3, 1e3
        cells = cells_of(rng, shape, n_rows=0 if turn == 4 else 60)
        power = shape * rng.normal(1.0, 0.2, (4, n_range))
        if turn > 0:
            cells[:, rng.random(n_range) < 0.1] = 0
            power[1, rng.random(n_range) < 0.2] *= 8  # somebody moves
        power = power[: 0 if turn == 5 else 4]
        unit = 10.0 ** rng.integers(-6, 6)
        level, noise, shape_db = expected(levels, shape_db, cells, power, unit)
        got_level, got = floor.update(cells, power, N_CPI, unit)
        assert got_level == pytest.approx(level, rel=1e-12)
        np.testing.assert_allclose(got, noise, rtol=1e-9)


def test_before_anything_changes_there_is_no_noise():
    floor = NoiseFloor(3, MOST_DB)
    none = np.zeros((0, 8), np.float32)
    assert floor.update(none, np.zeros((0, 8)), N_CPI, 1.0)[0] == 0.0
    level, noise = floor.update(np.zeros((60, 8), np.float32), np.ones((4, 8)), N_CPI, 1.0)
    assert (level, noise.any()) == (0.0, False)
    # What is first seen counts wholly: nothing was learned of bins that never changed.
    cells = cells_of(np.random.default_rng(1), np.full(8, 9.0))
    own = noise_profile(cells)
    level, noise = floor.update(cells, np.tile(own, (4, 1)), N_CPI, 1.0)
    assert level == 0.0
    level, noise = NoiseFloor(1, MOST_DB).update(cells, np.tile(own, (4, 1)), N_CPI, 2.0)
    assert level == pytest.approx(2 * noise_of(cells))
    assert np.median(noise) == pytest.approx(np.median(2 * own), rel=0.2)
