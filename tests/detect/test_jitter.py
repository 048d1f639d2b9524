from dataclasses import replace

import numpy as np
import pytest

from tests.clutter_helpers import ALL, AXIS, body, db, jitter_of, room
from tests.dsp_reference import remove_jitter, residual_power
from tests.radar_helpers import noise

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
    walker = body(2.9 - 0.9 * TIME_S, 45)
    frames = (where + walker + noise(147, 96)).astype(np.complex64)
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
    others = np.arange(147) != position
    assert np.abs(same_s - delay_s)[others].max() < 0.05e-12
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
