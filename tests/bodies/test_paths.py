"""Courses, timetables, footfalls, limbs and wanders: what motions are made of."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from x2radar.sim.bodies.path.courses import COURSES, draw_course
from x2radar.sim.bodies.path.path import Agility, Path
from x2radar.sim.bodies.path.prints import Footprints, StridePhase


@pytest.mark.parametrize("name", COURSES)
def test_courses_go_through_the_swath_and_not_through_the_radars_wall(name):
    n_seen = 0
    for seed in range(30):
        points = draw_course(np.random.default_rng(seed), name, 0.6, 3.4)
        assert np.linalg.norm(np.diff(points, axis=0), axis=1).min() >= 0.1
        way = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(points)])
        distance = np.linalg.norm(way, axis=1)
        n_seen += bool(((distance > 0.6) & (distance < 3.4)).any())
        path = Path.through(points, 1.0, turn_radius_m=(0.3, 0.5, 0.57)[seed % 3])
        # Between the radii that the course was judged by it may be a little nearer than 0.4 m.
        assert path.at(np.arange(0, path.end_s, 0.05)).y_m.min() > 0.37
    assert n_seen >= 28


POINT = st.tuples(st.integers(-8, 8), st.integers(0, 16)).map(lambda p: (p[0] / 2, p[1] / 2))


@settings(max_examples=25)
@given(
    st.lists(POINT, min_size=2, max_size=5).filter(lambda p: all(a != b for a, b in pairwise(p))),
    st.floats(0.1, 4.0),
    st.lists(st.tuples(st.floats(0.2, 2.0), st.floats(0.3, 3.0)), max_size=3),
    st.floats(0.05, 1.0),
)
def test_any_path_is_gone_along_within_its_limits(points, speed, stops, radius):
    agility = Agility()
    path = Path.through(points, speed, stops, turn_radius_m=radius, start_s=1.5)
    step_s = (path.end_s + 1.0) / 2000
    t_s = np.arange(0.0, path.end_s + 1.0, step_s)
    state = path.at(t_s)
    xy = np.stack([state.x_m, state.y_m], axis=1)
    v = np.linalg.norm(np.diff(xy, axis=0), axis=1) / step_s
    assert xy[0] == pytest.approx(points[0])
    assert xy[-1] == pytest.approx(points[-1], abs=1e-6)
    assert state.speed_mps.max() <= speed * (1 + 1e-9)
    assert path.cruise_mps == pytest.approx(state.speed_mps.max(), rel=0.02, abs=0.02)
    assert v == pytest.approx(0.5 * (state.speed_mps[1:] + state.speed_mps[:-1]), abs=0.02)
    assert np.abs(np.diff(state.speed_mps)).max() <= agility.acceleration_mps2 * step_s * 1.001
    assert np.abs(state.turn_rad_s).max() <= agility.turn_rad_s * 1.001
    assert v.sum() * step_s == pytest.approx(path.pieces[1, -1], rel=0.01, abs=0.02)
    # It stands at its stops that lie on the way.
    pauses, way = [], 0.0
    for gap, pause in stops:
        way += gap
        pauses += [pause] if way < path.pieces[1, -1] - 1e-6 else []
    stands = (state.speed_mps == 0) & (t_s > 1.5) & (t_s < path.end_s)
    assert stands.sum() * step_s == pytest.approx(sum(pauses), abs=0.1 + 6 * step_s * len(stops))


@pytest.mark.parametrize("seed", range(6))
def test_a_standing_foot_stands_and_a_standing_body_takes_no_strides(seed):
    rng = np.random.default_rng(seed)
    path = Path.through([(0.0, 6.0), (1.0, 3.0), (-1.0, 1.0)], 1.1, [(2.0, 1.5)])
    phase = StridePhase.along(path, lambda v: 0.4 + 0.6 * v)
    duty = rng.uniform(0.4, 0.7)
    prints = Footprints.plan(path, phase, offset=0.3, duty=duty, home_m=(0.0, 0.1), lift_m=0.1)
    t_s = np.arange(0, path.end_s, 0.01)
    place, swing = prints.at(t_s, np.ones(len(t_s)))
    stands = (swing[1:] == 0) & (swing[:-1] == 0)
    assert stands.mean() > 0.2
    assert np.abs(np.diff(place, axis=0)[stands]).max() < 1e-12
    assert (place[:, 2] >= 0).all()
    assert place[:, 2].max() == pytest.approx(0.1, rel=0.05)
    # Half-way through a stance the body is over it.
    middle = phase.time_s(np.arange(2.0, 4.0) + 0.3 + 0.5 * duty)
    at, body = prints.at(middle, np.ones(2))[0], path.at(middle)
    assert np.hypot(at[:, 0] - body.x_m, at[:, 1] - body.y_m) == pytest.approx(0.1, abs=0.01)
    strides, still = phase.at(t_s), path.at(t_s).speed_mps == 0
    assert still.sum() > 100
    assert np.abs(np.diff(strides)[still[1:] & still[:-1]]).max() < 5e-3
