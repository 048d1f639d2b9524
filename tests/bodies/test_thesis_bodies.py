"""The thesis' bodies: its formula, its draws."""

import math
from dataclasses import astuple

import numpy as np
import pytest

from x2radar.sim.bodies.thesis_bodies import THESIS_BODIES, draw, ranges


def range_by_formula(p, t):
    turn = 2 * math.pi * p.gait_hz * t
    y = p.y_m + p.vy_mps * t + p.swing_m * math.sin(turn + p.phase_rad)
    y += p.swing3_m * math.sin(3 * turn + p.phase_rad)
    return math.sqrt(p.x_m**2 + y**2 + p.z_m**2)


@pytest.mark.parametrize("name", THESIS_BODIES)
@pytest.mark.parametrize("seed", range(3))
def test_positions_follow_the_formula(name, seed):
    body = draw(THESIS_BODIES[name], np.random.default_rng(seed))
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
    drawn = draw(body, np.random.default_rng(7))
    changes = np.array([astuple(p) for p in drawn]) - np.array([astuple(p) for p in body])
    for column in (0, 1, 3, 4, 5, 6):
        assert changes[:, column] == pytest.approx(changes[0, column], abs=1e-12)
        assert changes[0, column] != 0
    assert not changes[:, [2, 7]].any()  # no variation of z and of the third harmonic
    share = [d.rcs_m2 / p.rcs_m2 for d, p in zip(drawn, body, strict=True)]
    assert share == pytest.approx([share[0]] * 5)
    assert drawn == draw(body, np.random.default_rng(7)) != draw(body, np.random.default_rng(8))
    # What a body draws does not depend on how many scatterers it has.
    assert draw(body[:1], np.random.default_rng(7)) == drawn[:1]


def test_spread_of_the_draws_is_the_tables_and_cross_sections_keep_a_floor():
    rng = np.random.default_rng(0)
    torso = THESIS_BODIES["thesis_human"][:1]
    drawn = np.array([astuple(draw(torso, rng)[0]) for _ in range(4000)])
    wanted = [0.75, 1.0, 0, 0.5, 0.25, math.pi / 4, 0.05, 0, 3000]
    assert drawn.std(axis=0) == pytest.approx(wanted, rel=0.05)
    mean = drawn.mean(axis=0) - np.array(astuple(torso[0]))
    assert np.abs(mean)[[0, 1, 3, 4, 5, 6]].max() < 0.06
    # One in 1300 would be below it.
    assert drawn[:, 8].min() == 0.05 * torso[0].rcs_m2
