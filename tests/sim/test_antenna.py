import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim_helpers import axis_of
from x2radar.sim.place.antenna import Antenna, length_m
from x2radar.sim.points import Points
from x2radar.sim.signal.pulse import LinkBudget

BASEBAND = axis_of("baseband")


def towards(azimuth_deg, elevation_deg, length=1.0):
    a, e = np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg)
    return length * np.array([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)])


def points(*position_m, rcs_m2=1.0):
    position_m = np.array(position_m, np.float64)[None]
    return Points(position_m, np.full(position_m.shape[:2], rcs_m2))


@pytest.mark.parametrize(("azimuth", "elevation"), [(65, 65), (30, 120), (170, 10)])
def test_half_power_lies_at_half_the_width(azimuth, elevation):
    a = Antenna(azimuth_width_deg=azimuth, elevation_width_deg=elevation, floor_db=-60)
    assert a.gain(towards(0, 0)) == pytest.approx(1)
    for side in (-1, 1):
        assert a.gain(towards(side * azimuth / 2, 0)) == pytest.approx(0.5)
        assert a.gain(towards(0, side * elevation / 2)) == pytest.approx(0.5)


@given(st.floats(-180, 180), st.floats(-90, 90), st.floats(1e-3, 1e3))
def test_gain_is_bounded_and_does_not_depend_on_distance(azimuth, elevation, length):
    for shape in ("gaussian", "isotropic"):
        a = Antenna(shape=shape, floor_db=-25)
        gain = a.gain(towards(azimuth, elevation, length))
        assert 10**-2.5 * (1 - 1e-12) <= gain <= 1
        assert gain == pytest.approx(a.gain(towards(azimuth, elevation)), rel=1e-6)
        # Right and left, up and down are alike.
        assert gain == pytest.approx(a.gain(towards(-azimuth, -elevation, length)), rel=1e-9)


@pytest.mark.parametrize(
    ("pan", "tilt"), [(0, 0), (30, 0), (-90, 0), (0, 25), (0, -90), (110, 40)]
)
def test_pan_and_tilt_turn_the_pattern(pan, tilt):
    """Pan goes to the right, tilt down."""
    a = Antenna(pan_deg=pan, tilt_deg=tilt, floor_db=-60)
    assert a.axis == pytest.approx(towards(pan, -tilt), abs=1e-12)
    assert a.gain(a.axis) == pytest.approx(1)
    if abs(tilt) < 90:
        assert a.gain(towards(pan, -tilt - 32.5)) == pytest.approx(0.5)
        assert a.gain(towards(pan, -tilt + 32.5)) == pytest.approx(0.5)
    if tilt == 0:
        assert a.gain(towards(pan + 32.5, 0)) == pytest.approx(0.5)


def test_direct_echoes_are_the_radar_equations_and_the_pattern_counts_out_and_back():
    a = Antenna(height_m=1.2)
    rows = a.direct(points((0, 2, 1.2), rcs_m2=0.7))
    assert rows.range_m[0, 0] == pytest.approx(2)
    ours = rows.amplitude(LinkBudget(), BASEBAND)
    wanted = LinkBudget().amplitude(np.array([2.0]), np.array([0.7]), BASEBAND)
    assert ours[0] == pytest.approx(wanted)
    a = Antenna(height_m=0.5)
    side = towards(32.5, 0) * 2 + [0, 0, 0.5]
    axis, off = a.direct(points((0, 2, 0.5))), a.direct(points(side))
    ratio = off.amplitude(LinkBudget(), BASEBAND) / axis.amplitude(LinkBudget(), BASEBAND)
    assert 20 * math.log10(ratio[0, 0]) == pytest.approx(-6.02, abs=0.01)


def test_points_are_left_alone_and_nothing_is_nearer_than_the_clamp():
    p = points((0, 0, 1.5), (0, 0.05, 1.5))
    before = p.rcs_m2.copy()
    rows = Antenna().direct(p)
    assert np.array_equal(p.rcs_m2, before)
    assert rows.range_m.tolist() == [[0.1, 0.1]]
    assert length_m(np.zeros((4, 3))).tolist() == [0.1] * 4
