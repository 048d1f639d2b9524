import numpy as np
import pytest

from radard.config.sections import GateSettings
from radard.detect.clutter_map import ClutterRemover
from radard.detect.gate import Gate
from radard.detect.tracks import Tracker, range_gates
from tests.clutter_helpers import AXIS, DATA, body, dwells_of_recording, needs_data, room
from tests.radar_helpers import dwell_of, noise

RATE_HZ = 60.0
FLOOR = np.ones(96)


def dwells(range_m, level_db=40, *, seconds=10.0, seed=0, lost=(), extra=()):
    """Dwells of 147 frames every second of bodies along ``range_m(t)``, in noise of one."""
    time_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    frames = noise(len(time_s), 96, seed=seed)
    for path, level in ((range_m, level_db), *extra):
        if path is not None:
            at = path(time_s)
            here = np.isfinite(at)
            frames[here] += body(at[here], level)
    for end in range(147, len(frames) + 1, 60):
        yield dwell_of(frames[end - 147 : end], lost=lost, axis=AXIS, end=end)


def follow(stream, tracker=None):
    tracker = tracker or Tracker()
    return [(dwell, tracker.update(dwell, FLOOR)) for dwell in stream]


def error_m(dwell, track, range_m):
    time_s = dwell.t_s - (147 - 0.5 - np.arange(147)) / RATE_HZ
    return np.abs(track.path_m - range_m(time_s))


@pytest.mark.parametrize("speed_mps", [1.8, 0.6, 0.2, -0.3, -1.5])
def test_a_walker_is_one_track_from_the_first_dwell(speed_mps):
    is_fast = abs(speed_mps) > 0.8
    start_m = 3.2 if speed_mps > 0 else 0.8

    def range_of(t):
        # The fast ones are in view for 1.4 s only, within the first dwell.
        at = start_m - speed_mps * (t - 1.0 * is_fast)
        return np.where((at > 0.7) & (at < 3.3), at, np.nan)

    for dwell, tracks in follow(dwells(range_of, seconds=2.45 if is_fast else 5)):
        assert [t.id for t in tracks] == [1]
        off = error_m(dwell, tracks[0], range_of)
        assert np.nanmean(off) < 0.06
        assert np.nanmax(off[30:]) < 0.25
        now_m = range_of(np.array([dwell.t_s]))[0]
        if np.isfinite(now_m):
            assert tracks[0].radial_velocity_mps == pytest.approx(speed_mps, abs=0.2)
            assert tracks[0].range_m == pytest.approx(now_m, abs=0.12)
        assert tracks[0].power_db == pytest.approx(40, abs=5)


def test_an_empty_room_has_no_tracks_nor_do_clutter_and_jitter_make_any():
    for seed in range(3):
        assert all(not tracks for _, tracks in follow(dwells(None, seconds=30, seed=seed)))
    remover, gate, tracker = ClutterRemover(), Gate(GateSettings()), Tracker()
    for k in range(8):
        dwell = remover.remove(dwell_of(room(seed=k), axis=AXIS, end=147 + 60 * k))
        gate.read(dwell)
        assert tracker.update(dwell, gate.background) == ()


def test_a_person_behind_a_dog_has_a_track_of_its_own():
    paths = (lambda t: 1.0 + 0.3 * np.sin(0.8 * t), lambda t: 2.6 - 0.1 * t)
    for dwell, tracks in follow(dwells(paths[0], 45, seconds=8, extra=[(paths[1], 30)])):
        assert [t.id for t in tracks] == [1, 2]
        for track, path in zip(tracks, paths, strict=True):
            assert error_m(dwell, track, path).mean() < 0.08


def test_bodies_that_cross_keep_their_tracks_and_limbs_do_not_split_one():
    near, far = (lambda t: 1.0 + 0.25 * t), (lambda t: 3.0 - 0.25 * t)
    seen = follow(dwells(near, 45, seconds=8, extra=[(far, 27)]))
    last, tracks = seen[-1]
    by_id = {t.id: t for t in tracks}
    assert error_m(last, by_id[1], near)[-30:].mean() < 0.1
    assert by_id[1].radial_velocity_mps < 0
    assert {t.id for _, found in seen[:2] for t in found} == {1, 2}
    trunk = lambda t: 2.2 - 0.3 * t  # noqa: E731
    limb = lambda t: trunk(t) + 0.28 * np.sin(2 * np.pi * 0.9 * t)  # noqa: E731
    seen = follow(dwells(trunk, 40, seconds=5, extra=[(limb, 36)]))
    assert max(len(tracks) for _, tracks in seen) == 1


def test_a_track_dies_when_its_body_goes_and_ids_are_never_given_twice():
    def path(t):
        return np.where((t < 4) | (t > 9), 2.0 + 0.1 * np.sin(3 * t), np.nan)

    tracker = Tracker()
    ids = [[t.id for t in tracks] for _, tracks in follow(dwells(path, seconds=14), tracker)]
    assert ids[0] == [1]
    assert [] in ids
    assert ids[-1] == [2]
    tracker.reset()
    assert [t.id for t in follow(dwells(path, seconds=4), tracker)[-1][1]] == [3]


def test_coasting_stays_near_where_it_was_lost():
    def path(t):
        return np.where(t < 4, 3.0 - 0.4 * t, np.nan)

    seen = follow(dwells(path, seconds=7))
    for dwell, tracks in seen:
        for track in tracks:
            if dwell.t_s > 4.3:
                assert track.range_m == pytest.approx(1.4, abs=0.3)
            assert dwell.t_s <= 4 + 1.5 + 0.2
    assert seen[-1][1] == ()


@pytest.mark.parametrize("position", range(0, 147, 12))
def test_a_gap_anywhere_leaves_the_track_alone(position):
    def path(t):
        return 2.4 - 0.3 * t

    ((dwell, tracks),) = follow(dwells(path, seconds=2.45, lost=range(position, position + 3)))
    assert [t.id for t in tracks] == [1]
    assert error_m(dwell, tracks[0], path).mean() < 0.06


def test_gates_follow_their_tracks_and_share_what_they_overlap():
    paths = np.array([np.linspace(1.0, 1.6, 50), np.linspace(2.6, 1.8, 50), np.full(50, 3.2)])
    range_m = AXIS.range_m
    gates = range_gates(paths, range_m)
    assert gates.shape == (3, 50, 96)
    assert gates.dtype == np.float32
    assert gates.min() >= 0
    assert gates.sum(axis=0).max() <= 1 + 1e-6
    for gate, path in zip(gates, paths, strict=True):
        for frame in (0, 25, 49):
            off = np.abs(range_m - path[frame])
            np.testing.assert_array_equal(gate[frame][off > 0.6 + 1e-6], 0)
    # Alone, a gate is one about its track and a half at its half width.
    alone = range_gates(paths[:1], range_m)[0, 0]
    off = np.abs(range_m - 1.0)
    np.testing.assert_array_equal(alone[off < 0.4 - 1e-6], 1)
    assert np.interp(1.5, range_m, alone) == pytest.approx(0.5, abs=0.05)
    # In the middle between two tracks each has a half.
    between = [np.interp(1.7, range_m, gate[49]) for gate in gates[:2]]
    assert between == pytest.approx([0.5, 0.5], abs=0.03)
    same = range_gates(np.full((2, 3), 2.0), range_m)
    np.testing.assert_allclose(same[0], same[1])
    assert same.sum(axis=0).max() == pytest.approx(1)
    assert range_gates(np.zeros((0, 5)), range_m).shape == (0, 5, 96)


def test_gates_tell_a_person_from_the_fan_before_it():
    def fan(t):
        return 1.0 + 0.02 * np.sin(2 * np.pi * 7 * t)

    def person(t):
        return 2.8 - 0.3 * t

    clean = {"seconds": 2.45, "seed": 3}
    ((dwell, tracks),) = follow(dwells(fan, 45, extra=[(person, 30)], **clean))
    assert len(tracks) == 2
    gates = range_gates(np.stack([t.path_m for t in tracks]), AXIS.range_m)
    far = max(range(2), key=lambda k: tracks[k].range_m)
    ((alone, _),) = follow(dwells(person, 30, **clean))
    mine = dwell.frames * gates[far]
    wanted = alone.frames * gates[far]
    assert np.linalg.norm(mine - wanted) < 0.05 * np.linalg.norm(wanted)


def test_a_tracker_that_rested_finds_who_walked_in_meanwhile():
    def range_m(t):
        at = 4.2 - 0.6 * (t - 4.0)
        return np.where((t > 4.0) & (at < 3.3), at, np.nan)

    tracker, found, is_following = Tracker(), [], []
    for k, dwell in enumerate(dwells(range_m)):
        # Nobody is in sight before 5.5 s: the gate is closed in the first three dwells.
        if k > 2 or tracker.is_following:
            found = tracker.update(dwell, FLOOR)
        is_following.append(tracker.is_following)
        if k > 4:
            assert [round(track.range_m, 1) for track in found] == pytest.approx(
                [round(4.2 - 0.6 * (dwell.t_s - 4.0), 1)], abs=0.11
            )
    assert is_following[:3] == [False] * 3
    assert is_following[-1]


def recorded(name, step=4):
    """Tracks of a recording, dwell by dwell."""
    gate, tracker = Gate(GateSettings()), Tracker()
    for dwell in dwells_of_recording(DATA / name, step):
        gate.read(dwell)
        yield dwell.t_s, tracker.update(dwell, gate.background)


# Read off the range-time maps of the recordings by eye, to a decimetre or two.
WALK_101 = {3.4: 5.5, 6.4: 5.0, 10.4: 4.25, 12.4: 3.7, 14.4: 3.1, 17.4: 3.95, 20.4: 4.7}
WALK_102 = {2.4: 4.8, 4.4: 4.15, 7.4: 3.2, 9.4: 3.4, 11.4: 3.95, 13.4: 4.6, 19.4: 4.45}
VISIBLE = {"p410_walk_101.mat": WALK_101, "p410_walk_102.mat": WALK_102}


@needs_data
@pytest.mark.parametrize("name", sorted(VISIBLE))
def test_real_walks_are_tracked(name):
    found = {round(t_s, 1): tracks for t_s, tracks in recorded(name)}
    for t_s, range_m in VISIBLE[name].items():
        near = [abs(t.range_m - range_m) for t in found[t_s]]
        assert min(near, default=9) < 0.25, (t_s, range_m, [t.range_m for t in found[t_s]])
