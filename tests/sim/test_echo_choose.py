"""Which tier `auto` takes, and that whatever it takes keeps the error asked for."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.echo_references import passband
from tests.sim_helpers import axis_of
from x2radar.errors import SceneError
from x2radar.sim.echo import Pulse, Task, choose, frames

X2, RF = axis_of("baseband"), axis_of("rf")
DECIMATED = replace(X2, n_range=96, bin_length_m=8 * X2.bin_length_m)
P4XX = replace(X2, n_range=143, bin_length_m=0.0274, carrier_hz=4e9, bandwidth_hz=1.7e9)
TINY = replace(X2, n_range=2)
AXES = {"x2": X2, "rf": RF, "decimated": DECIMATED, "two bins": TINY}
ERRORS_DB = (-20.0, -60.0, -80.0, -100.0, -110.0, -130.0)
SHAPES = ((1, 1), (30, 20), (400, 20), (400, 1), (147, 60))


def task(axis, n_slow=400, n_points=20, error_db=-60.0):
    return Task(n_slow, n_points, axis, Pulse.of(axis), error_db)


def scene(axis, n_slow, n_points, seed=0):
    rng = np.random.default_rng(seed)
    low, high = axis.range_m[0], axis.range_m[-1]
    range_m = rng.uniform(low - 0.1, high + 0.1, (n_slow, n_points))
    return range_m, rng.uniform(0.01, 1, range_m.shape)


# ---------------------------------------------------------------- what is chosen


def test_every_tier_has_its_tasks():
    assert choose(task(X2)) == "gridded"  # short bins, many echoes
    assert choose(task(DECIMATED)) == "local"  # what training asks for
    assert choose(task(P4XX, 152, 60, -50.0)) == "local"  # training for another radar
    assert choose(task(X2, 1, 3, -90.0)) == "dense"  # a scene's static points
    assert choose(task(X2, error_db=-120.0)) == "dense"  # nothing else is fine enough


# ---------------------------------------------------------------- what comes out


@pytest.mark.parametrize("name", AXES)
@pytest.mark.parametrize("error_db", ERRORS_DB)
def test_auto_keeps_the_error(name, error_db):
    axis = AXES[name]
    range_m, amplitude = scene(axis, 24, 7)
    wanted = passband(range_m, amplitude, axis)
    ours = frames(range_m, amplitude, axis, error_db=error_db)
    assert ours.dtype == wanted.dtype
    error = np.abs(ours.astype(np.complex128) - wanted).max(axis=1) / amplitude.sum(axis=1)
    # Two results rounded to float32 differ by that alone.
    assert error.max() <= 10 ** (error_db / 20) + 3e-7


# ---------------------------------------------------------------- what is refused


def test_refusals_name_what_is_wrong():
    range_m, amplitude = scene(X2, 2, 2)
    for error_db in (-131.0, 0.0, math.nan, -math.inf):
        with pytest.raises(SceneError, match="not within -130 to -20"):
            frames(range_m, amplitude, X2, error_db=error_db)
        with pytest.raises(SceneError, match="not within -130 to -20"):
            choose(task(X2, error_db=error_db))
    with pytest.raises(SceneError, match="n_points"):
        frames(range_m, amplitude[:, :1], X2)
