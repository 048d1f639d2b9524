"""Measures of a walk against made-up walks with known answers; and the recorded one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from radard.errors import FeatureError
from tests.sim_helpers import axis_with
from walk_numbers import follow, measure
from walks import RADARS_X_M, compare, recorded_walk, simulated_walk, walk_scene
from x2radar.sim.echo import frames as echo_frames

pytestmark = pytest.mark.nightly
RATE_HZ = 30.5
AXIS = axis_with(
    "baseband", 440, 0.01, 0.8, carrier_hz=4.0e9, bandwidth_hz=1.7e9, sample_rate_hz=1.6e10
)
T_S = np.arange(round(16 * RATE_HZ)) / RATE_HZ
COMING_M = 5.0 - 0.25 * T_S
# Of an echo's power behind the matched filter: sigma 0.042 m.
SIGMA_M = 0.0425
DATA = Path(__file__).parents[3] / "shared" / "data"
RECORDINGS = [DATA / f"p410_walk_{n}.mat" for n in (101, 102)]


def record(*parts, noise=1e-3, clutter=30.0):
    """Frames of points, each of range and amplitude, before clutter that stands still."""
    range_m = np.stack([r for r, _ in parts], axis=1)
    amplitude = np.stack([np.broadcast_to(a, T_S.shape) for _, a in parts], axis=1)
    frames = echo_frames(range_m, amplitude.astype(np.float64), AXIS, error_db=-80)
    rng = np.random.default_rng(0)
    white = rng.standard_normal((2, *frames.shape))
    still = clutter * rng.standard_normal((2, AXIS.n_range))
    return (frames + noise * (white[0] + 1j * white[1]) + still[0] + 1j * still[1]).astype(
        np.complex64
    )


def walk(*parts, **kwargs):
    return follow(record(*parts, **kwargs), AXIS, RATE_HZ)


# ---------------------------------------------------------------- the way


def test_a_point_is_followed_to_a_centimetre_whatever_the_clutter():
    found = walk((COMING_M, 1.0))
    counts = found.is_walking
    assert counts.mean() > 0.75
    true_m = COMING_M[round(RATE_HZ) // 2 :][: len(counts)]
    assert np.abs(found.path_m - true_m)[counts].max() < 0.01
    assert found.rate_mps[counts] == pytest.approx(-0.25, abs=0.01)


def test_turns_and_stops_do_not_count():
    there_and_back = 2.0 + np.abs(0.3 * (T_S - 8.0))
    counts = walk((there_and_back, 1.0)).is_walking
    t_s = T_S[: len(counts)] + 0.5
    assert not counts[np.abs(t_s - 8.0) < 0.7].any()
    assert counts[(t_s > 2) & (t_s < 6)].all()


def test_somebody_who_stays_or_a_short_record_is_refused():
    with pytest.raises(FeatureError, match="nobody walks"):
        walk((2.0 + 0.02 * np.sin(5 * T_S), 1.0))
    with pytest.raises(FeatureError, match="needs 4 s"):
        follow(record((COMING_M, 1.0))[:60], AXIS, RATE_HZ)


# ---------------------------------------------------------------- the numbers


def test_a_lone_point_has_no_limbs_and_the_pulse_for_an_extent():
    numbers = measure(walk((COMING_M, 1.0)))
    assert numbers.speed_mps == pytest.approx(0.25, abs=0.005)
    assert numbers.speed_sd_mps < 0.01
    assert numbers.torso_rms_m < 0.005
    assert numbers.limb_mps < 0.1
    assert numbers.coherence > 0.97
    # A Gaussian's width 6 and 15 dB down, and a cell of the map.
    assert numbers.extent_m == pytest.approx(2 * SIGMA_M * np.sqrt(0.6 * np.log(10) * 2), abs=0.03)
    assert numbers.reach_m == pytest.approx(SIGMA_M * np.sqrt(1.5 * np.log(10) * 2), abs=0.02)
    assert max(numbers.behind_db) < -35


@pytest.mark.parametrize(("size_m", "rate_hz"), [(0.02, 0.7), (0.03, 0.9), (0.015, 1.1)])
def test_a_torso_that_swings_is_measured_in_range_and_in_velocity(size_m, rate_hz):
    turn = 2 * np.pi * rate_hz * T_S
    numbers = measure(walk((COMING_M + size_m * np.sin(turn), 1.0)))
    assert numbers.torso_rms_m == pytest.approx(size_m / np.sqrt(2), rel=0.12)
    assert numbers.edge_rms_m == pytest.approx(size_m / np.sqrt(2), rel=0.15)
    speed = 2 * np.pi * rate_hz * size_m / np.sqrt(2)
    # A CPI of a third of a second averages over some of it.
    assert 0.6 * speed < numbers.torso_mps < 1.05 * speed


def test_a_limb_that_reaches_out_is_seen_when_it_does():
    plain = measure(walk((COMING_M, 1.0)))
    ahead = 0.4 * np.maximum(np.sin(2 * np.pi * 0.45 * T_S), 0.0)
    limb = [(COMING_M - share * ahead, 0.35) for share in (0.35, 0.7, 1.0)]
    numbers = measure(walk((COMING_M, 1.0), *limb))
    # Out for half of the time.
    assert numbers.far_reach_m > plain.far_reach_m + 0.15
    assert numbers.reach_m < plain.reach_m + 0.15
    assert numbers.swing_rms_m > 5 * plain.swing_rms_m
    assert numbers.limb_mps > plain.limb_mps


@pytest.mark.parametrize("rate_hz", [0.7, 0.85, 1.0])
def test_bursts_of_a_leg_that_swings_now_and_then(rate_hz):
    # Still for two thirds of the time, then quick: as a foot against the body.
    phase = (rate_hz * T_S) % 1.0
    swing = np.where(phase < 0.35, 0.5 - 0.5 * np.cos(np.pi * phase / 0.35), 1 - phase)
    leg = COMING_M - 0.15 * (np.where(phase < 0.35, swing, (1 - phase) / 0.65) - 0.5)
    numbers = measure(walk((COMING_M, 1.0), (leg, 0.5)))
    assert numbers.step_hz == pytest.approx(rate_hz, abs=0.06)


def test_power_behind_is_that_of_what_follows_the_body():
    numbers = measure(walk((COMING_M, 1.0), (COMING_M + 1.0, 0.25)))
    spread = np.sqrt(2 * np.pi) * SIGMA_M / 0.5
    assert numbers.behind_db[1] == pytest.approx(
        20 * np.log10(0.25) + 10 * np.log10(spread), abs=1
    )
    assert numbers.behind_db[3] < numbers.behind_db[1] - 15


# ---------------------------------------------------------------- recorded and simulated


def test_a_simulated_walk_is_the_same_again_and_one_person_for_both_radars():
    axis = replace(AXIS, n_range=480, bin_length_m=0.00915)
    first, again = (simulated_walk(3, axis, 30.5, 0.0) for _ in range(2))
    assert np.array_equal(first, again)
    ways = [follow(simulated_walk(3, axis, 30.5, x), axis, 30.5).path_m for x in RADARS_X_M]
    # The two ranges meet on the floor of the room, all the way.
    x = (ways[0] ** 2 - ways[1] ** 2 + 16.0) / 8.0
    assert (ways[0] ** 2 > x**2).all()
    assert x[100:600].min() > 0.5
    assert x.max() < 3.5
    assert walk_scene(4.0).steps == walk_scene(4.0).steps


@pytest.mark.skipif(
    not all(p.exists() for p in RECORDINGS),
    reason="the recorded walks are not part of the project",
)
def test_simulated_people_walk_as_the_recorded_one_does():
    made, _ = compare([recorded_walk(path) for path in RECORDINGS], 12, lambda *_: None)
    rows = {row.name: row for row in made}
    for name in (
        "range rate, mean",
        "near edge (-6 dB), oscillation, rms",
        "limbs ahead of the way, 90 %",
        "body extent (-6 dB), median",
        "power 0.5 m behind the body",
        "power 1 m behind the body",
        "power 2.5 m behind the body",
    ):
        assert rows[name].is_within, rows[name]
