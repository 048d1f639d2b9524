"""What does not move: clutter, spikes, noise and jitter."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from radard.detect.clutter_map import ClutterMap, ClutterRemover
from radard.dsp import clutter
from radard.dsp.clutter import centre_spread_m, noise_profile, second_differences, sound_rows
from radard.dsp.downconvert import DownConverter
from tests.clutter_helpers import ALL, AXIS, body, db, jitter_of, room
from tests.dsp_reference import noise_power, remove_jitter, residual_power
from tests.radar_helpers import dwell_of, noise, walker
from tests.sim_helpers import axis_of


def reference_power(frames, valid, n_cpi):
    """Residual power by its definition, in float64."""
    n = len(frames) // n_cpi
    y = frames[-n * n_cpi :].astype(np.complex128).reshape(n, n_cpi, -1)
    v = valid[-n * n_cpi :].reshape(n, n_cpi)
    rows = []
    for cpi, good in zip(y, v, strict=True):
        if good.sum() >= max(2, n_cpi / 2):
            part = cpi[good] - cpi[good].mean(axis=0)
            rows.append((np.abs(part) ** 2).sum(axis=0) / (good.sum() - 1))
    return np.array(rows)


dwell = partial(dwell_of, axis=AXIS)


@pytest.mark.parametrize("sigma", [1e-43, 1e-18, 1e-3, 1.0, 1e3, 1e30])
def test_pure_noise_is_unbiased_in_any_unit(sigma):
    frames = (noise(147, 768).astype(np.complex128) * sigma).astype(np.complex64)
    # A unit near the least float32 is a rough one: the noise is quantised there.
    slack = 0.3 if sigma > 1e-40 else 1.0
    assert db(residual_power(frames, ALL, 28).mean()) == pytest.approx(db(sigma**2), abs=slack)
    assert db(noise_power(frames, ALL)) == pytest.approx(db(sigma**2), abs=slack)


@pytest.mark.parametrize("clutter_db", [0, 40, 80, 100, 120, 140])
def test_residual_power_is_exact_whatever_clutter_lies_under_it(clutter_db):
    frames = noise(147, 64) + noise(1, 64, seed=9, sigma=10 ** (clutter_db / 20))
    frames = frames.astype(np.complex64)
    got, wanted = residual_power(frames, ALL, 28), reference_power(frames, ALL, 28)
    np.testing.assert_allclose(got, wanted, rtol=1e-5)


@pytest.mark.parametrize("value", [0.0, 5.0, -1e30, 1e-42])
def test_equal_frames_have_no_power(value):
    frames = np.full((147, 64), value, np.complex64)
    assert not residual_power(frames, ALL, 28).any()
    assert noise_power(frames, ALL) == 0


@pytest.mark.parametrize("bad", [np.nan, -np.inf, 1e39, 1e6])
@pytest.mark.parametrize("position", [0, 1, 27, 73, 119, 145, 146])
def test_rows_that_are_lost_or_not_finite_are_left_out(bad, position):
    frames = noise(147, 64).astype(np.complex128)
    frames[position, 5] = complex(bad, 1)
    good = np.arange(147) != position
    valid = good if bad == 1e6 else ALL
    wanted = reference_power(np.nan_to_num(frames), good, 28)
    np.testing.assert_allclose(residual_power(frames, valid, 28), wanted, rtol=1e-5)
    assert noise_power(frames, valid) == pytest.approx(1, rel=0.1)
    rows, usable, _ = sound_rows(frames, valid)
    assert np.isfinite(rows).all()
    np.testing.assert_array_equal(usable, good)


def test_frames_stay_as_they_were_and_may_be_read_only():
    frames = noise(147, 64)
    frames[3] = np.nan
    before = frames.copy()
    frames.flags.writeable = False
    residual_power(frames, ALL, 28)
    noise_power(frames, ALL)
    ClutterRemover().remove(dwell(frames))
    np.testing.assert_array_equal(frames, before)


def spikes(frames, valid=ALL):
    rows, usable, _ = sound_rows(frames, valid)
    return np.flatnonzero(clutter.spike_rows(rows, usable)).tolist()


@pytest.mark.parametrize("position", range(147))
def test_a_spike_at_every_position(position):
    frames = room()
    frames[position] += 3000
    assert spikes(frames) == [position]


@pytest.mark.parametrize("speed_mps", [0.0, 0.3, 1.2, 4.0, 11.0])
def test_what_moves_is_no_spike(speed_mps):
    assert not spikes(noise(147) + walker(147, 60, speed_mps=speed_mps, start_m=2.4, level=100))


def test_spikes_among_lost_frames_in_short_records_and_of_clipped_frames():
    frames, valid = noise(147), ALL.copy()
    frames[70] += 1e5
    valid[[69, 72]] = False
    assert spikes(frames, valid) == [70]
    assert not spikes(frames[68:72], ALL[:4])
    axis = axis_of("rf")
    rng = np.random.default_rng(4)
    rf = 50 + 30 * np.sin(np.arange(axis.n_range)) + 0.04 * rng.standard_normal((60, 1))
    rf = (rf + 0.04 * rng.standard_normal(rf.shape)).astype(np.float32)
    rf[31] = np.clip(3 * rf[31], 0, 100)
    assert spikes(DownConverter(axis, 8).convert(rf), ALL[:60]) == [31]


def test_spread_of_the_centre():
    power = np.full((4, 10), 1.0)
    range_m = np.arange(10.0)
    assert centre_spread_m(power, 1.0, range_m) == 0
    power[:, 3] = 100
    assert centre_spread_m(power, 1.0, range_m) == 0
    power[2, 3], power[2, 7] = 1, 50
    assert centre_spread_m(power, 1.0, range_m) == pytest.approx(4)
    power[2, 7] = 8  # too weak beside the others to count
    assert centre_spread_m(power, 1.0, range_m) == 0


def test_noise_of_single_bins():
    frames = noise(147, 64, sigma=2.0)
    frames[:60, 20] += np.linspace(0, 500, 60) ** 2  # under half of the time
    rows, usable, scale = sound_rows(frames, ALL)
    profile = noise_profile(second_differences(rows, usable)) * scale**2
    assert profile.mean() == pytest.approx(4, rel=0.1)
    assert profile.std() < 0.25 * 4
    assert profile[20] < 3 * 4
    empty = second_differences(rows[:2], usable[:2])
    assert np.isnan(clutter.noise_of(empty))
    assert np.isnan(noise_profile(empty)).all()


def test_map_begins_as_a_mean_and_follows_drift():
    room_map = ClutterMap(3, 60.0)
    blocks = [np.array([1, 2j, 3.0]) * k for k in range(5)]
    for block in blocks:
        room_map.update(block, 60, np.ones(3))
    np.testing.assert_allclose(room_map.mean, np.mean(blocks, axis=0))
    for _ in range(60):
        room_map.update(np.full(3, 9 + 0j), 60, np.ones(3))
    np.testing.assert_allclose(room_map.mean, 9, atol=9 * np.exp(-60 / 20) * 1.5)


@pytest.mark.parametrize(("motion", "time_s"), [(1, 20), (2, 20), (20, 200), (1e9, 600)])
def test_rates_are_bounded_and_slower_where_something_moves(motion, time_s):
    room_map = ClutterMap(1, 60.0)
    for _ in range(60):
        room_map.update(np.zeros(1, np.complex128), 60, np.ones(1))
    for _ in range(10):
        room_map.update(np.ones(1, np.complex128), 60, np.full(1, float(motion)))
    assert room_map.mean[0].real == pytest.approx(1 - np.exp(-10 / time_s), rel=0.08)
    room_map.update(np.full(1, 1e6 + 0j), 0, np.ones(1))
    assert room_map.mean[0].real < 1


@pytest.mark.parametrize("level", [1e-40, 1.0, 1e30])
def test_map_is_as_good_after_a_million_frames_as_after_a_thousand(level):
    n_hops, n_hop, memory = 1_000_000 // 60, 60, 1200
    rng = np.random.default_rng(5)
    blocks = 1e4 + rng.standard_normal((1000, 4)) + 1j * rng.standard_normal((1000, 4))
    exact, count = np.zeros(4, np.clongdouble), np.longdouble(0)
    room_map = ClutterMap(4, 60.0)
    errors = []
    for k in range(n_hops):
        block = blocks[k % 1000]
        room_map.update(block * level, n_hop, np.ones(4))
        count += n_hop
        exact += (block.astype(np.clongdouble) - exact) * (n_hop / count)
        count = min(count, np.longdouble(memory))
        if k in (16, n_hops - 1):
            wrong = np.abs(room_map.mean / level - exact.astype(np.complex128)).max() / 1e4
            errors.append(float(wrong))
    assert max(errors) < 1e-12


def test_remover_leaves_noise_and_doppler_and_counts_spikes():
    remover = ClutterRemover()
    for k in range(4):
        out = remover.remove(replace(dwell(room(seed=k)), t_s=2.45 + k))
        assert db(residual_power(out.frames, out.valid, 28).mean()) < 1
        # The map itself is gone, too, all but the jitter of its estimate.
        assert db(np.mean(np.abs(out.frames) ** 2)) < 3
        assert out.n_lost == 0
    # Doppler stays.
    target = body(2.4 - 0.5 * np.arange(147) / 60, 30)
    still = room(jitter_s=0, gain=0)
    out = ClutterRemover().remove(dwell((still + target).astype(np.complex64)))
    steps = np.diff(still + target, axis=0)
    assert np.abs(np.diff(out.frames, axis=0) - steps).std() < 0.05 * np.abs(steps).std()
    # Spikes are counted, and repeat the row before.
    frames = room()
    frames[40] += 3000
    frames[90] = np.nan
    out = ClutterRemover().remove(dwell(frames))
    assert np.flatnonzero(~out.valid).tolist() == [40, 90]
    assert out.n_lost == 2
    np.testing.assert_array_equal(out.frames[40], out.frames[39])
    np.testing.assert_array_equal(out.frames[90], out.frames[89])
    assert np.isfinite(out.frames).all()


def test_remover_keeps_the_map_through_a_person():
    remover = ClutterRemover()
    quiet = [room(seed=k, jitter_s=0, gain=0) for k in range(6)]
    for k in range(5):
        remover.remove(replace(dwell(quiet[k]), t_s=2.45 + k))
    standing = body(np.full(147, 1.7), 40)
    out = remover.remove(replace(dwell((quiet[5] + standing).astype(np.complex64)), t_s=7.45))
    # Who came and stands still is in the room, not of it.
    assert np.abs(out.frames[-1]).max() > 0.5 * 100


TIME_S = np.arange(147) / 60


def level_db(frames, valid=ALL):
    return db(residual_power(frames, valid, 28).mean())


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_residue_of_strong_clutter_comes_back_to_the_noise(seed):
    frames = room(seed=seed)
    quiet = level_db(noise(147, 96, seed=seed + 50))
    assert level_db(frames) > quiet + 4
    clean, found_s, found_gain = remove_jitter(frames, ALL, AXIS)
    assert level_db(clean) < quiet + 1
    delay_s, gain = jitter_of(147, seed=seed)
    assert np.corrcoef(found_s, delay_s)[0, 1] > 0.99
    assert np.corrcoef(found_gain, gain)[0, 1] > 0.9
    assert found_s.std() == pytest.approx(delay_s.std(), rel=0.05)


@pytest.mark.parametrize(
    ("peak_db", "jitter"),
    [*((db, 0) for db in (-20, 0, 20, 57, 100)), *((db, 1) for db in (-40, 0, 10))],
)
def test_harmless_without_jitter_or_clutter(peak_db, jitter):
    frames = room(peak_db=peak_db, jitter_s=jitter * 0.2e-12, gain=jitter * 1e-3)
    clean, *_ = remove_jitter(frames, ALL, AXIS)
    before, after = (residual_power(f, ALL, 28).mean(axis=0) for f in (frames, clean))
    assert db(after.mean()) == pytest.approx(db(before.mean()), abs=0.1)
    assert jitter or np.abs(db(after) - db(before)).max() < 1


MOTIONS = {
    "breathing": 1.9 + 2.5e-3 * np.sin(2 * np.pi * 0.3 * TIME_S),
    "slow": 1.9 - 0.2 * TIME_S,
    "walking": 3.2 - 1.2 * TIME_S,
    "swaying": 1.0 + 0.3 * np.sin(2 * np.pi * TIME_S),
}


@pytest.mark.parametrize("jitter_s", [0, 0.2e-12])
@pytest.mark.parametrize("level", [20, 40, 60])
@pytest.mark.parametrize("range_m", MOTIONS.values(), ids=MOTIONS)
def test_motion_stays(range_m, level, jitter_s):
    target = body(range_m, level)
    kind = {"jitter_s": jitter_s, "gain": jitter_s / 0.2e-9}
    alone, *_ = remove_jitter(room(**kind), ALL, AXIS)
    both, *_ = remove_jitter(room(target=target, **kind), ALL, AXIS)
    moving, left = (each - each.mean(axis=0) for each in (target, both - alone))
    kept = np.abs(np.vdot(moving, left)) ** 2 / np.vdot(moving, moving).real ** 2
    assert 0.95 <= kept < 1.05


def test_one_reflector_alone_confirms_nothing_and_three_leave_no_ghost():
    still = np.full(147, 1.9)
    moving = body(1.9 + 2e-4 * np.sin(2 * np.pi * 1.2 * TIME_S), 60)
    frames = (moving + noise(147, 96)).astype(np.complex64)
    clean, *_ = remove_jitter(frames, ALL, AXIS)
    assert level_db(clean) == pytest.approx(level_db(frames), abs=0.2)
    assert level_db(frames) > level_db(body(still, 60) + noise(147, 96)) + 3
    where = body(np.tile([0.8, 1.9, 3.0], (147, 1)), 50)
    frames = (where + body(2.9 - 0.9 * TIME_S, 45) + noise(147, 96)).astype(np.complex64)
    clean, *_ = remove_jitter(frames, ALL, AXIS)
    before, after = (residual_power(f, ALL, 28) for f in (frames, clean))
    far = before < 2
    assert after[far].mean() < 1.3 * before[far].mean()


@pytest.mark.parametrize("position", range(0, 147, 7))
def test_lost_frames_have_no_vote(position):
    frames = room()
    clean, delay_s, _ = remove_jitter(frames, ALL, AXIS)
    torn = frames.copy()
    torn[position] = np.nan if position % 2 else 1e6
    valid = ALL.copy()
    valid[position] = False
    without, same_s, _ = remove_jitter(torn, valid, AXIS)
    assert np.abs(same_s - delay_s)[np.arange(147) != position].max() < 0.05e-12
    assert level_db(without, valid) == pytest.approx(level_db(clean), abs=0.1)


@pytest.mark.parametrize(
    "frames",
    [
        *(np.full((147, 96), value, np.complex64) for value in (0, 3 + 4j, np.nan)),
        *(noise(3, 96), noise(147, 1), noise(147, 2) + 1e3, np.eye(147, 96, dtype=np.complex64)),
    ],
    ids=["zeros", "equal", "nan", "three frames", "one bin", "two bins", "spikes"],
)
def test_odd_dwells_come_back_finite(frames):
    axis = replace(AXIS, n_range=frames.shape[1])
    clean, delay_s, gain = remove_jitter(frames, np.ones(len(frames), np.bool_), axis)
    assert clean.shape == frames.shape
    assert np.isfinite(clean).all()
    assert np.isfinite([delay_s, gain]).all()


def test_other_sign_of_phase_and_unknown_bandwidth():
    frames = room()
    clean, delay_s, _ = remove_jitter(frames, ALL, AXIS)
    mirrored, same_s, _ = remove_jitter(frames.conj(), ALL, replace(AXIS, phase_sign=1))
    np.testing.assert_allclose(mirrored, clean.conj(), atol=1e-3)
    np.testing.assert_allclose(same_s, delay_s, atol=1e-17)
    rough, *_ = remove_jitter(frames, ALL, replace(AXIS, bandwidth_hz=0))
    assert level_db(rough) < level_db(frames) - 4
