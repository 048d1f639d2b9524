import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES, Scatterer, Variation, draw, ranges

HALF = math.pi / 2
# x0, y0, z0, vy0, gait, phase, swing, third harmonic, cross section: the thesis' tables.
TABLES = {
    "thesis_human": [
        (0, 2.5, 0, -1, 2, HALF, 0.1, 0, 10_000),
        (0.25, 2.5, 0, -1, 1, HALF, 0.3, 0.02, 500),
        (-0.25, 2.5, 0, -1, 1, -HALF, 0.3, 0.02, 500),
        (0.12, 2.5, -0.6, -1, 1, -HALF, 0.2, 0.01, 1000),
        (-0.12, 2.5, -0.6, -1, 1, HALF, 0.2, 0.01, 1000),
    ],
    "thesis_dog": [
        (0, 2.5, 0, -1, 2, HALF, 0.1, 0, 5000),
        (0.10, 2.5, 0, -1, 1, HALF, 0.1, 0.01, 500),
        (-0.10, 2.5, 0, -1, 1, -HALF, 0.1, 0.01, 500),
        (0.10, 3.0, 0, -1, 1, -HALF, 0.1, 0.01, 500),
        (-0.10, 3.0, 0, -1, 1, HALF, 0.1, 0.01, 500),
    ],
    "thesis_cat": [
        (0, 2.5, 0, -1, 2.6, HALF, 0.04, 0, 2000),
        (0.075, 2.5, 0, -1, 1.3, HALF, 0.05, 0.01, 200),
        (-0.075, 2.5, 0, -1, 1.3, -HALF, 0.05, 0.01, 200),
        (0.075, 2.8, 0, -1, 1.3, -HALF, 0.05, 0.01, 200),
        (-0.075, 2.8, 0, -1, 1.3, HALF, 0.05, 0.01, 200),
    ],
}


def row(p):
    return (
        p.x_m,
        p.y_m,
        p.z_m,
        p.vy_mps,
        p.gait_hz,
        p.phase_rad,
        p.swing_m,
        p.swing3_m,
        p.rcs_m2,
    )


def range_by_formula(p, t):
    turn = 2 * math.pi * p.gait_hz * t
    y = p.y_m + p.vy_mps * t
    y += p.swing_m * math.sin(turn + p.phase_rad)
    y += p.swing3_m * math.sin(3 * turn + p.phase_rad)
    return math.sqrt(p.x_m**2 + y**2 + p.z_m**2)


def test_bodies_are_the_tables_of_the_thesis():
    assert set(THESIS_BODIES) == set(TABLES)
    for name, rows in TABLES.items():
        ours = [row(p) for p in THESIS_BODIES[name]]
        assert ours[0] == rows[0]  # the torso comes first
        assert sorted(ours) == sorted(rows)


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_positions_follow_the_formula(name, seed):
    body = THESIS_BODIES[name]
    if seed is not None:
        body = draw(body, np.random.default_rng(seed))
    t_s = np.concatenate([np.arange(0, 5, 1 / 60), [100.0, 86_400.0]])
    ours, rcs = ranges(body, t_s)
    assert ours.shape == (t_s.size, 5)
    assert ours.dtype == np.float64
    wanted = np.array([[range_by_formula(p, t) for p in body] for t in t_s])
    assert np.abs(ours - wanted).max() < 1e-9
    assert np.abs(ours[:-2] - wanted[:-2]).max() < 1e-14
    assert rcs.tolist() == [p.rcs_m2 for p in body]


def test_a_body_starts_where_the_table_says_and_approaches():
    range_m, _ = ranges(THESIS_BODIES["thesis_human"], np.array([0.0, 1.0]))
    assert range_m[0, 0] == pytest.approx(2.6)  # 2.5 m and a swing of 0.1 m at its top
    assert range_m[1, 0] == pytest.approx(1.6)


def test_nobody_and_no_time():
    range_m, rcs = ranges((), np.arange(7.0))
    assert range_m.shape == (7, 0)
    assert rcs.shape == (0,)
    range_m, _ = ranges(THESIS_BODIES["thesis_dog"], np.zeros(0))
    assert range_m.shape == (0, 5)


@pytest.mark.parametrize("name", TABLES)
def test_one_draw_is_shared_by_all_scatterers(name):
    body = THESIS_BODIES[name]
    drawn = draw(body, np.random.default_rng(7))
    changes = np.array([row(p) for p in drawn]) - np.array([row(p) for p in body])
    for column in (0, 1, 3, 4, 5, 6):
        assert changes[:, column] == pytest.approx(changes[0, column], abs=1e-12)
        assert changes[0, column] != 0
    assert not changes[:, [2, 7]].any()  # no variation of z and of the third harmonic
    share = [d.rcs_m2 / p.rcs_m2 for d, p in zip(drawn, body, strict=True)]
    assert share == pytest.approx([share[0]] * 5)


def test_same_generator_same_draw():
    body = THESIS_BODIES["thesis_cat"]
    assert draw(body, np.random.default_rng(3)) == draw(body, np.random.default_rng(3))
    assert draw(body, np.random.default_rng(3)) != draw(body, np.random.default_rng(4))
    # What a body draws does not depend on how many scatterers it has.
    one = draw(body[:1], np.random.default_rng(3))
    assert one == draw(body, np.random.default_rng(3))[:1]


def test_spread_of_the_draws_is_the_tables():
    rng = np.random.default_rng(0)
    torso = THESIS_BODIES["thesis_human"][:1]
    drawn = np.array([row(draw(torso, rng)[0]) for _ in range(4000)])
    spread = drawn.std(axis=0)
    wanted = [0.75, 1.0, 0, 0.5, 0.25, math.pi / 4, 0.05, 0, 3000]
    assert spread == pytest.approx(wanted, rel=0.05)
    mean = drawn.mean(axis=0)
    assert np.abs(mean - TABLES["thesis_human"][0])[[0, 1, 3, 4, 5, 6]].max() < 0.06


def test_cross_section_keeps_a_floor():
    body = THESIS_BODIES["thesis_human"]
    wild = Variation(rcs_fraction=100.0)
    floors = 0
    for seed in range(40):
        for p, d in zip(body, draw(body, np.random.default_rng(seed), wild), strict=True):
            assert d.rcs_m2 >= 0.05 * p.rcs_m2
            floors += d.rcs_m2 == 0.05 * p.rcs_m2
    assert floors > 0


@given(
    st.tuples(*[st.floats(-10, 10) for _ in range(8)]),
    st.floats(0, 1e4),
)
def test_any_scatterer_stays_within_its_triangle(numbers, t):
    p = Scatterer(*numbers, 1.0)
    range_m = ranges((p,), np.array([t]))[0][0, 0]
    reach = abs(p.swing_m) + abs(p.swing3_m)
    straight = math.sqrt(p.x_m**2 + (p.y_m + p.vy_mps * t) ** 2 + p.z_m**2)
    assert abs(range_m - straight) <= reach + 1e-8
    assert range_m == pytest.approx(range_by_formula(p, t), abs=1e-8)
