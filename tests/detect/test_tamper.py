"""Tamper: told from people, furniture, drift and losses, in any unit, on every scene."""

from dataclasses import replace

import numpy as np
import pytest

from radard.config.config import Config
from radard.config.sections import TamperSection
from radard.detect.tamper import TamperWatch, is_frozen, read_cells
from radard.pipeline import Pipeline
from radard.stream.source import open_source
from tests.clutter_helpers import DATA, needs_data
from tests.radar_helpers import BASEBAND, dwell_of, dwells_in, walker

RATE_HZ = 60.0
N_SLOW = 147
AXIS = replace(BASEBAND, n_range=128)
SETTINGS = TamperSection(learn_s=5, hold_s=16)
SLOW, FAST = 15, 3  # the dwell in which a change is found, and one of twice the limit


def room(seed=1, level=30.0):
    """Still echoes all over the range, (n_range,), complex."""
    parts = np.random.default_rng(seed).standard_normal((2, AXIS.n_range)) * level
    smooth = np.ones(3) / np.sqrt(3)
    return np.convolve(parts[0], smooth, "same") + 1j * np.convolve(parts[1], smooth, "same")


class Stream:
    """Dwells of a room with noise of power 1, a second apart."""

    def __init__(self, echoes, *, seed=0, unit=1.0):
        self.echoes, self.unit, self.noise = echoes, unit, 1.0
        self.rng = np.random.default_rng(seed)
        self.k = 0
        self.now = ()
        self.blocks = self.rng.standard_normal((16, N_SLOW, AXIS.n_range, 2)) / np.sqrt(2)

    def dwell(self, motion=None):
        parts = self.blocks[self.k % 16] * np.sqrt(self.noise)
        frames = parts[..., 0] + 1j * parts[..., 1] + self.echoes
        if motion is not None:
            frames = frames + motion
        self.k += 1
        return dwell_of((frames * self.unit).astype(np.complex64), end=N_SLOW + 60 * self.k)

    def found(self, watch, n, motion=lambda _k: None):
        """Return when which kinds were on, over n dwells: [(dwell, kinds), ...] at changes."""
        changes = []
        for k in range(n):
            kinds = tuple(f.kind for f in watch.update(self.dwell(motion(k))))
            if kinds != self.now:
                changes.append((k, kinds))
                self.now = kinds
        return changes


def walking(k):
    """Motion of somebody who walks to and fro."""
    start = 1.0 + 2.5 * abs((k % 10) / 5 - 1)
    track = walker(N_SLOW, RATE_HZ, speed_mps=0.5, start_m=start, level=300.0)
    return np.pad(track, ((0, 0), (0, AXIS.n_range - track.shape[1])))


def crowded(_k):
    """Motion all over the place."""
    return np.exp(1j * np.linspace(0, 40, N_SLOW))[:, None] * room(seed=3, level=300.0)


@pytest.fixture
def learned():
    stream, watch = Stream(room()), TamperWatch(SETTINGS)
    assert watch.is_blind
    assert stream.found(watch, 8) == []
    assert not watch.is_blind
    return stream, watch


@pytest.mark.parametrize("unit", [1e-12, 1e-3, 1e6, 1e12])
@pytest.mark.parametrize("change_db", [-6.5, -30.0, 6.5])
def test_a_covered_sensor(unit, change_db):
    stream, watch = Stream(room(), unit=unit), TamperWatch(SETTINGS)
    stream.found(watch, 8)
    usual = stream.echoes
    stream.echoes = usual * 10 ** (change_db / 20)
    assert stream.found(watch, 18) == [(FAST if abs(change_db) >= 12 else SLOW, ("covered",))]
    stream.echoes = usual
    assert stream.found(watch, 18) == [(SLOW, ())]


@pytest.mark.parametrize(
    ("echoes", "kind", "reason"),
    [
        (np.zeros(AXIS.n_range), "covered", "still echoes fell "),
        (room(seed=2), "moved", "echoes agree "),
    ],
)
def test_echoes_that_die_to_noise_and_a_moved_sensor(learned, echoes, kind, reason):
    stream, watch = learned
    stream.echoes = echoes
    assert stream.found(watch, 6) == [(FAST, (kind,))]
    assert watch.update(stream.dwell())[0].reason.startswith(reason)


@pytest.mark.parametrize("change_db", [-7.0, 7.0, 20.0])
def test_a_jump_of_the_noise(learned, change_db):
    stream, watch = learned
    stream.noise = 10 ** (change_db / 10)
    assert stream.found(watch, 18) == [(FAST if abs(change_db) >= 12 else SLOW, ("noise",))]
    stream.noise = 1.0
    assert stream.found(watch, 18) == [(SLOW, ())]


@pytest.mark.parametrize("change_db", [-4.0, 4.0])
def test_small_changes_are_none(learned, change_db):
    stream, watch = learned
    stream.echoes = stream.echoes * 10 ** (change_db / 20)
    stream.noise = 10 ** (change_db / 10)
    assert stream.found(watch, 20) == []


def test_what_does_not_last_and_people_and_furniture_are_none(learned):
    stream, watch = learned
    usual = stream.echoes
    for _ in range(4):
        stream.echoes = room(seed=2)
        assert stream.found(watch, 3) == []
        stream.echoes = usual
        assert stream.found(watch, 2) == []
    stream, watch = learned
    assert stream.found(watch, 30, walking) == []
    chair = stream.echoes.copy()
    chair[40:60] += 200.0
    stream.echoes = chair
    assert stream.found(watch, 30) == []


def test_a_common_phase_is_drift_and_slow_change_is_followed(learned):
    stream, watch = learned
    old, new = room(), room(seed=2)
    # Two thirds of the room are another one's within half an hour.
    for k in range(2000):
        share = k / 3000
        stream.echoes = ((1 - share) * old + share * new) * np.exp(0.01j * k)
        assert watch.update(stream.dwell()) == ()


def test_a_void_cannot_be_judged_but_its_noise_can_and_what_lasts_is_told():
    stream, watch = Stream(np.zeros(AXIS.n_range)), TamperWatch(SETTINGS)
    assert stream.found(watch, 10) == []
    assert watch.is_blind
    stream.noise = 10.0
    assert stream.found(watch, 19) == [(SLOW, ("noise",))]
    assert stream.found(watch, 3) == [(0, ("covered", "noise"))]
    reason = watch.update(stream.dwell())[0].reason
    assert reason == "no still echoes for 30 s: is the antenna connected and clear?"
    # Connected at last: that is the room.
    stream.echoes, stream.noise = room(), 1.0
    assert stream.found(watch, 20)[-1][1] == ()
    assert not watch.is_blind


def test_somebody_who_was_there_from_the_start_is_not_learned_as_the_room():
    stream, watch = Stream(room()), TamperWatch(SETTINGS)
    stream.found(watch, 20, crowded)
    assert watch.is_blind
    stream.found(watch, 8)
    assert not watch.is_blind
    # Where everything moves no echo is judged, nor who walks about where there are none.
    assert stream.found(watch, 40, crowded) == []
    assert Stream(np.zeros(AXIS.n_range)).found(TamperWatch(SETTINGS), 60, walking) == []


def test_lost_frames_and_tiny_dwells():
    frames = Stream(room()).dwell().frames
    assert read_cells(dwell_of(frames, lost=range(144, 147))).noise_db is None
    few = dwell_of(frames[:3, :64])
    assert read_cells(few) is None
    assert read_cells(dwell_of(frames[:, :8])) is None
    assert TamperWatch(SETTINGS).update(few) == ()


def test_noise_is_read_within_half_a_decibel_and_frozen_frames_are_seen():
    levels = [read_cells(Stream(room(), seed=k).dwell()).noise_db for k in range(20)]
    assert np.abs(levels).max() < 1.0
    assert abs(np.mean(levels)) < 0.5
    dwell = Stream(room()).dwell()
    assert not is_frozen(dwell)
    still = np.repeat(dwell.frames[:1], N_SLOW, axis=0)
    assert is_frozen(replace(dwell, frames=still))
    one_bin = still.copy()
    one_bin[-2, 5] += 1
    assert not is_frozen(replace(dwell, frames=one_bin))
    assert not is_frozen(replace(dwell, frames=still, valid=np.zeros(N_SLOW, np.bool_)))


def findings_of(port, settings, change=lambda _t_s, frames: frames):
    """Every kind found in a recording."""
    source = open_source(port, speed="max")
    watch, found = TamperWatch(settings), set()
    for dwell in dwells_in(Pipeline(source.stream, Config(), None).make_ring(), source.frames()):
        if dwell.is_whole:
            changed = replace(dwell, frames=change(dwell.t_s, dwell.frames))
            found |= {finding.kind for finding in watch.update(changed)}
    source.close()
    return found


def shifted(frames, n_bins):
    """The frames of a sensor that was moved away by so many bins."""
    moved = np.zeros_like(frames)
    moved[:, n_bins:] = frames[:, :-n_bins]
    return moved


@needs_data
@pytest.mark.parametrize("name", ["p410_walk_101.mat", "p410_walk_102.mat", "x4m03_recording"])
@pytest.mark.parametrize(
    ("change", "kinds"),
    [
        (lambda frames: shifted(frames, 11), {"moved"}),  # 10 cm
        (lambda frames: shifted(frames, 2), set()),  # 2 cm
        (lambda frames: frames * np.float32(0.3), {"covered"}),
        (None, set()),
    ],
)
def test_a_real_room_that_changes_while_somebody_walks_in_it(name, change, kinds):
    port = f"replay:{DATA / name}"
    if change is None:
        assert findings_of(port, TamperSection()) == kinds
    elif name != "x4m03_recording":
        settings = TamperSection(learn_s=6, hold_s=5)
        assert findings_of(port, settings, lambda t_s, f: change(f) if t_s > 16 else f) == kinds
