"""What motions are made of: courses, timetables, footfalls, and the formula of the thesis."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from x2radar.sim.bodies.path.feet import Footprints, StridePhase
from x2radar.sim.bodies.path.path import COURSES, Agility, Path, draw_course
from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES, ranges
from x2radar.sim.bodies.thesis_bodies import draw as draw_body


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
    phase = StridePhase(path, lambda v: 0.4 + 0.6 * v)
    duty = rng.uniform(0.4, 0.7)
    prints = Footprints(path, phase, offset=0.3, duty=duty, home_m=(0.0, 0.1), lift_m=0.1)
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


def range_by_formula(p, t):
    turn = 2 * math.pi * p.gait_hz * t
    y = p.y_m + p.vy_mps * t + p.swing_m * math.sin(turn + p.phase_rad)
    y += p.swing3_m * math.sin(3 * turn + p.phase_rad)
    return math.sqrt(p.x_m**2 + y**2 + p.z_m**2)


@pytest.mark.parametrize("name", THESIS_BODIES)
@pytest.mark.parametrize("seed", range(3))
def test_positions_follow_the_formula(name, seed):
    body = draw_body(THESIS_BODIES[name], np.random.default_rng(seed))
    t_s = np.concatenate([np.arange(0, 5, 1 / 60), [100.0, 86_400.0]])
    ours, rcs = ranges(body, t_s)
    wanted = np.array([[range_by_formula(p, t) for p in body] for t in t_s])
    assert np.abs(ours - wanted).max() < 1e-9
    assert np.abs(ours[:-2] - wanted[:-2]).max() < 1e-14
    assert rcs.tolist() == [p.rcs_m2 for p in body]
    assert ranges(body, np.zeros(0))[0].shape == (0, 5)
    assert ranges((), t_s)[0].shape == (len(t_s), 0)


@pytest.mark.parametrize("name", THESIS_BODIES)
def test_one_draw_is_shared_by_all_scatterers(name):
    body = THESIS_BODIES[name]
    drawn = draw_body(body, np.random.default_rng(7))
    changes = np.array(drawn) - np.array(body)
    for column in (0, 1, 3, 4, 5, 6):
        assert changes[:, column] == pytest.approx(changes[0, column], abs=1e-12)
        assert changes[0, column] != 0
    assert not changes[:, [2, 7]].any()  # no variation of z and of the third harmonic
    share = [d.rcs_m2 / p.rcs_m2 for d, p in zip(drawn, body, strict=True)]
    assert share == pytest.approx([share[0]] * 5)
    again, other = (draw_body(body, np.random.default_rng(seed)) for seed in (7, 8))
    assert drawn == again != other
    # What a body draws does not depend on how many scatterers it has.
    assert draw_body(body[:1], np.random.default_rng(7)) == drawn[:1]


def test_spread_of_the_draws_is_the_tables_and_cross_sections_keep_a_floor():
    rng = np.random.default_rng(0)
    torso = THESIS_BODIES["thesis_human"][:1]
    drawn = np.array([draw_body(torso, rng)[0] for _ in range(4000)])
    wanted = [0.75, 1.0, 0, 0.5, 0.25, math.pi / 4, 0.05, 0, 3000]
    assert drawn.std(axis=0) == pytest.approx(wanted, rel=0.05)
    assert np.abs(drawn.mean(axis=0) - np.array(torso[0]))[[0, 1, 3, 4, 5, 6]].max() < 0.06
    # One in 1300 would be below it.
    assert drawn[:, 8].min() == 0.05 * torso[0].rcs_m2
