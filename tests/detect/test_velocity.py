from dataclasses import replace

import numpy as np
import pytest

from radard.dsp.velocity import VelocityTransform, range_frequencies
from radard.errors import FeatureError
from tests.dsp_helpers import P4XX, X2, X4, error, point

LIGHT_MPS = 299_792_458.0


def columns(frames, axis, rate_hz):
    stream = VelocityTransform(axis, rate_hz)
    stream.push(frames)
    return stream.columns()


def passing(axis, rate_hz, speed_mps, **kwargs):
    """Mean column of a point that passes the middle of the swath."""
    stream = VelocityTransform(axis, rate_hz, step_mps=0.02, column_rate_hz=1e9, **kwargs)
    middle_m = float(axis.range_m[axis.n_range // 2])
    frames = point(axis, rate_hz, stream.n_cpi + 6, velocity_mps=speed_mps, middle_m=middle_m)
    stream.push(frames)
    return stream.velocity_mps, stream.columns().mean(axis=1)


RADARS = [
    *((X2, 30.0, 2.5), (X2, 60.0, 5.0), (X2, 200.0, 8.0), (P4XX, 30.5, 3.5)),
    *((X4, 17.06, 0.5), (X4, 50.0, 3.0), (X4, 200.0, 6.0)),
]


@pytest.mark.parametrize(("axis", "rate_hz", "least_db"), RADARS)
@pytest.mark.parametrize("speed_mps", [0.6, 1.2, 2.0, 3.6, -1.2, -3.6])
def test_true_velocity_and_suppressed_aliases(axis, rate_hz, least_db, speed_mps):
    grid, power = passing(axis, rate_hz, speed_mps)
    assert grid[power.argmax()] == pytest.approx(speed_mps, abs=0.03)
    alias_mps = LIGHT_MPS / axis.carrier_hz * rate_hz / 2
    elsewhere = np.abs(grid - speed_mps) > alias_mps / 2
    assert 10 * np.log10(power.max() / power[elsewhere].max()) > least_db


@pytest.mark.parametrize("speed_mps", [7.0, -11.0, 15.0])
def test_velocities_to_15_mps(speed_mps):
    # At 15 m/s the point crosses a swath of 7 m in 0.47 s: the swath of an X4.
    axis = replace(X4, n_range=182)
    grid, power = passing(axis, 200.0, speed_mps, max_mps=16.0)
    assert grid[power.argmax()] == pytest.approx(speed_mps, abs=0.05)


@pytest.mark.parametrize("step", [2, 4])
def test_decimated_bins_give_the_same_map(step):
    fine = replace(X2, n_range=384, bin_length_m=X2.bin_length_m / 4)
    frames = point(fine, 60.0, 40, velocity_mps=1.0, middle_m=2.0)
    coarse = replace(fine, n_range=384 // step, bin_length_m=fine.bin_length_m * step)
    ours = columns(frames[:, ::step], coarse, 60.0) * step
    assert error(ours, columns(frames, fine, 60.0)) < 1e-3


def test_frequencies():
    f = range_frequencies(replace(X2, n_range=768, bin_length_m=0.003656))
    assert len(f) == 49
    assert f[24] == 6.8e9
    assert f[-1] - 6.8e9 == pytest.approx(1.28e9, abs=0.03e9)
    assert len(range_frequencies(X4)) == 49
    assert len(range_frequencies(P4XX)) == 57
    few = range_frequencies(P4XX, 20)
    assert 10 <= len(few) <= 20
    assert len(range_frequencies(X2, 1)) == 1
    unknown = range_frequencies(replace(X2, bandwidth_hz=0.0))
    assert unknown[0] > 5.8e9
    for wrong in (replace(X2, carrier_hz=0.0), replace(X2, bin_length_m=0.0)):
        with pytest.raises(FeatureError, match="no frequencies"):
            range_frequencies(wrong)
