"""What an installation knows: strength of the echo, and the input made of it."""

import numpy as np
import pytest

from radard.judge.features import FEATURES, FeatureSettings, FeatureStream, feature_shape
from radard.judge.installation import (
    INSTALLATION,
    N_INSTALLATION,
    Mount,
    echo_at_1m_db,
    installation,
)
from tests.radar_helpers import dwell_of, noise

RANGE_M = np.arange(0.5, 3.5, 0.03)


def power_of(at_m, excess, noise=2.0):
    power = np.full(len(RANGE_M), noise)
    power[int(np.argmin(np.abs(RANGE_M - at_m)))] += excess
    return power, np.full(len(RANGE_M), noise)


def test_an_echo_is_as_strong_at_1_m_wherever_it_is():
    near = echo_at_1m_db(*power_of(1.01, 2000.0), RANGE_M)
    far = echo_at_1m_db(*power_of(2.03, 2000.0 / 2.0099**4), RANGE_M)
    assert near == pytest.approx(30.0, abs=0.3)
    assert far == pytest.approx(near, abs=0.3)


def test_a_body_over_several_bins_counts_whole():
    one, floor = power_of(2.0, 3000.0)
    spread = floor.copy()
    at = int(np.argmax(one))
    spread[at - 1 : at + 2] += 1000.0
    assert echo_at_1m_db(spread, floor, RANGE_M) == pytest.approx(
        echo_at_1m_db(one, floor, RANGE_M), abs=0.3
    )


@pytest.mark.parametrize("scale", [1e-150, 1.0, 1e150])
def test_strength_does_not_depend_on_the_unit(scale):
    power, floor = power_of(1.5, 500.0)
    assert echo_at_1m_db(power * scale, floor * scale, RANGE_M) == pytest.approx(
        echo_at_1m_db(power, floor, RANGE_M)
    )


@pytest.mark.parametrize(
    ("power", "floor"),
    [(np.ones(4), np.ones(4)), (np.zeros(4), np.zeros(4)), (np.full(4, np.inf), np.ones(4))],
)
def test_nothing_that_moves_has_no_strength(power, floor):
    assert echo_at_1m_db(power, floor, RANGE_M[:4]) is None


def test_the_feature_is_what_is_known_or_the_rate_alone():
    dwell = dwell_of(noise(120), rate_hz=30.0)
    settings = FeatureSettings(n_cpi=14)
    assert INSTALLATION in FEATURES
    assert feature_shape(INSTALLATION, settings) == (N_INSTALLATION,)
    stream = FeatureStream(settings, (INSTALLATION,))
    assert stream.extract(dwell)[INSTALLATION].tolist() == [-1.0] + [0.0] * 6
    known = installation(30.0, Mount(height_m=2.0))
    again = FeatureStream(settings, (INSTALLATION,)).extract(dwell, known)
    assert again[INSTALLATION].tolist() == known.tolist()


@pytest.mark.parametrize(
    ("rate_hz", "mount", "echo_db", "made"),
    [
        (60.0, Mount(), None, [0, 0, 0, 0, 0, 0, 0]),
        (60.0, Mount(level_db=50.0), None, [0, 0, 0, 0, 0, 0, 0]),
        (60.0, Mount(), 40.0, [0, 0, 0, 0, 0, 0, 0]),
        (
            120.0,
            Mount(height_m=3.0, tilt_deg=-15.0, level_db=50.0),
            40.0,
            [1, 1, 1, 1, -0.5, 1, -1],
        ),
        (1e-9, Mount(level_db=-1e9), 1e9, [-4, 0, 0, 0, 0, 1, 4]),
    ],
)
def test_what_is_known_is_told_within_bounds_and_the_rest_is_zero(rate_hz, mount, echo_db, made):
    found = installation(rate_hz, mount, echo_db)
    assert found.dtype == np.float32
    assert found.tolist() == made
