"""What an installation knows: strength of the echo, and the input made of it."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radard.config.config import load_config
from radard.judge.bundle import load_bundle
from radard.judge.classifier import Classifier
from radard.judge.features import FEATURES, FeatureSettings, FeatureStream, feature_shape
from radard.judge.installation import (
    INSTALLATION,
    N_INSTALLATION,
    echo_at_1m_db,
    installation,
    size_nats,
)
from radard.pipeline import Pipeline
from tests.radar_helpers import BASEBAND, dwell_of, dwells_in, frames_of, noise, walker
from x2radar.frame import StreamInfo

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
    # A body over several bins counts whole.
    one, floor = power_of(2.0, 3000.0)
    spread = floor.copy()
    at = int(np.argmax(one))
    spread[at - 1 : at + 2] += 1000.0
    assert echo_at_1m_db(spread, floor, RANGE_M) == pytest.approx(
        echo_at_1m_db(one, floor, RANGE_M), abs=0.3
    )


def test_strength_does_not_depend_on_the_unit_and_nothing_that_moves_has_none():
    power, floor = power_of(1.5, 500.0)
    usual = echo_at_1m_db(power, floor, RANGE_M)
    for scale in (1e-150, 1e150):
        assert echo_at_1m_db(power * scale, floor * scale, RANGE_M) == pytest.approx(usual)
    for power, floor in (np.ones((2, 4)), np.zeros((2, 4)), (np.full(4, np.inf), np.ones(4))):
        assert echo_at_1m_db(power, floor, RANGE_M[:4]) is None


def test_the_feature_is_what_is_known_or_the_rate_alone():
    dwell = dwell_of(noise(120), rate_hz=30.0)
    settings = FeatureSettings(n_cpi=14)
    assert INSTALLATION in FEATURES
    assert feature_shape(INSTALLATION, settings) == (N_INSTALLATION,)
    stream = FeatureStream(settings, (INSTALLATION,))
    assert stream.extract(dwell)[INSTALLATION].tolist() == [-1.0] + [0.0] * 6
    known = installation(30.0, height_m=2.0)
    again = FeatureStream(settings, (INSTALLATION,)).extract(dwell, known)
    assert again[INSTALLATION].tolist() == known.tolist()


@pytest.mark.parametrize(
    ("known", "made"),
    [
        ((60.0,), [0, 0, 0, 0, 0, 0, 0]),
        ((120.0, 3.0, -15.0, -10.0), [1, 1, 1, 1, -0.5, 1, -1]),
        ((1e-9, None, None, 2e9), [-4, 0, 0, 0, 0, 1, 4]),
    ],
)
def test_what_is_known_is_told_within_bounds_and_the_rest_is_zero(known, made):
    found = installation(*known)
    assert found.dtype == np.float32
    assert found.tolist() == made


@given(st.lists(st.floats(-1e6, 1e6), min_size=2))
def test_more_strength_never_speaks_for_a_pet_and_never_for_more_than_its_bounds(strengths_db):
    nats = [size_nats(each) for each in sorted(strengths_db)]
    assert all(a <= b for a, b in itertools.pairwise(nats))
    assert min(nats) >= -2.0
    assert max(nats) <= 0.5
    # Of bodies as strong as an adult it says next to nothing.
    assert abs(size_nats(0.0)) < 0.1
    assert size_nats(-8.0) == pytest.approx(-1.07, abs=0.02)


def test_a_level_changes_the_verdict_by_what_size_says_and_nothing_else():
    """The network sees the same; as strong an echo before a stronger radar is a smaller body."""
    classifier = Classifier(load_bundle("fast"))
    moving = walker(480, 60.0, speed_mps=0.2, start_m=2.0, level=60.0)
    frames = (moving + noise(480)).astype(np.complex64)
    made = {}
    for level_db in (None, 20.0, 90.0):
        config = load_config(environ={}, options={"mount": {"level_db": level_db}})
        pipeline = Pipeline(StreamInfo(BASEBAND, 60.0, "module"), config, classifier)
        dwells = dwells_in(pipeline.make_ring(), frames_of(frames))
        decided = [d for d in map(pipeline.decide, dwells) if d.fused is not None]
        made[level_db] = [d.window for d in decided], [d.fused for d in decided]
    plain, large, small = (np.log([p.human / p.pet for p in fused]) for _, fused in made.values())
    assert len(plain) >= 3
    assert made[None][0] == made[20.0][0] == made[90.0][0]
    assert large - plain == pytest.approx(np.full(len(plain), 0.5), abs=1e-6)
    assert small - plain == pytest.approx(np.full(len(plain), -2.0), abs=1e-6)
