"""Birds and moths: wings that beat, perches, rounds."""

import numpy as np
import pytest

from tests.body_helpers import ANTENNA_M, BIRDS, draw, drawn, speeds
from x2radar.sim.bodies.flyer import BIRD_MASS_KG, MOTH_BEAT_HZ

FLYERS = [*BIRDS, ("moth", "")]
MANY_S = np.arange(0, 60, 0.37)


@pytest.mark.parametrize(("kind", "style"), FLYERS)
def test_flight_has_no_jumps_and_stays_near_home(kind, style):
    home_m = (0.3, 2.0, 1.5)
    for seed in range(2):
        flyer = drawn(kind, style, seed, home_m=home_m)
        place, _, effort = flyer.motion.flight.at(np.arange(0, 62, 0.002))
        assert speeds(place, 0.002).max() < 8
        assert 0 <= effort.min() <= effort.max() <= 1
        away = np.linalg.norm(flyer.at(MANY_S, ANTENNA_M).position_m - home_m, axis=-1)
        assert away.max() < (0.4 if kind == "moth" else 1.6) + flyer.motion.build.span_m


def test_small_birds_and_moths_beat_faster_and_within_what_is_published():
    beats = {
        kg: np.mean([draw("pigeon", "", k, mass_kg=kg).motion.build.beat_hz for k in range(12)])
        for kg in (0.02, 0.035, 0.1, 0.3)
    }
    assert list(beats.values()) == sorted(beats.values(), reverse=True)
    assert beats[0.035] == pytest.approx(14, abs=1.5)
    assert beats[0.3] == pytest.approx(7.7, abs=0.8)
    every = [draw(kind, "", k).motion.build.beat_hz for kind in BIRD_MASS_KG for k in range(10)]
    assert 6 < min(every) < max(every) < 20
    builds = [draw("moth", "", seed).motion.build for seed in range(60)]
    moths = np.array([b.beat_hz for b in builds])
    assert MOTH_BEAT_HZ[0] <= moths.min() < 28
    assert 45 < moths.max() <= MOTH_BEAT_HZ[1]
    assert np.corrcoef([b.span_m for b in builds], moths)[0, 1] < -0.7
