"""What tamper is measured against outlives the daemon, a reload and a calibration that fails."""

import io
import logging

import numpy as np
import pytest

from radard.config.sections import GateSettings, TamperSection
from radard.detect.gate import Gate
from radard.detect.interference import FloorReference, InterferenceWatch
from radard.detect.tamper import RoomReference, RoomStore, TamperWatch
from tests.radar_helpers import dwell_of, noise

SETTINGS = TamperSection(learn_s=5, hold_s=16)
TONE = 30 * np.exp(2j * np.pi * 13 / 60 * np.arange(147))[:, None] * np.ones(64)
ECHOES = (30 * np.random.default_rng(2).standard_normal((2, 64))).T @ [1, 1j]


class Sensor:
    """A gate and a watch before a room, dwell after dwell; a new one is a restart."""

    def __init__(self, store=None, settings=SETTINGS, known=None):
        self.gate = Gate(GateSettings())
        self.store = store or RoomStore()
        self.watch = TamperWatch(settings, known=known or self.store.load())
        self.k = 0

    def listen(self, n, added=0, gain=1.0, *, has_gate=True):
        """Return after how many dwells which kinds were found first."""
        for k in range(n):
            frames = noise(147, seed=self.k) + gain * ECHOES + added
            dwell = dwell_of(frames.astype(np.complex64))
            self.k += 1
            if has_gate:
                self.gate.read(dwell)
            found = self.watch.update(dwell, self.gate if has_gate else None)
            if (room := self.watch.take_due()) is not None:
                self.store.save(room)
            if found:
                return k + 1, {each.kind for each in found}
        return None


def arrays_of(store):
    with np.load(store.path) as kept:
        return dict(kept)


@pytest.fixture
def store(tmp_path):
    return RoomStore(tmp_path / "radar.room.npz", "a stream")


def test_a_jammer_or_cover_that_is_on_at_a_restart_is_announced(store):
    assert Sensor(store).listen(40) is None
    assert store.path.stat().st_mode & 0o777 == 0o600
    again = RoomStore(store.path, "a stream")
    k, kinds = Sensor(again).listen(20, added=TONE)
    assert k <= 10
    assert "interference" in kinds
    assert Sensor(again).listen(20, gain=0.1) == (4, {"covered"})
    # As it was: nothing to tell, and nothing to learn.
    sensor = Sensor(again)
    assert not sensor.watch.is_blind
    assert sensor.listen(40) is None


def test_without_a_reference_what_is_on_at_the_start_is_the_room(store):
    assert Sensor(store).listen(40, gain=0.1) is None
    assert Sensor(RoomStore(store.path, "another stream")).listen(40) is None
    # With one, other settings do not take what is there now for it.
    sensor = Sensor()
    assert sensor.watch.known is None
    sensor.listen(40)
    changed = Sensor(settings=TamperSection(learn_s=20, hold_s=12), known=sensor.watch.known)
    assert changed.listen(20, gain=0.1) == (3, {"covered"})


def test_what_is_kept_is_of_a_room_in_which_nothing_is_wrong(store):
    sensor = Sensor(store)
    assert sensor.listen(40) is None
    kept = store.path.read_bytes()
    assert sensor.listen(20, gain=0.1) is not None
    for _ in range(700):
        sensor.listen(1, gain=0.1, has_gate=False)
    assert store.path.read_bytes() == kept
    assert sensor.watch.known is not None


def test_it_follows_the_room_and_is_kept_every_ten_minutes(store):
    sensor = Sensor(store)
    sensor.listen(40)
    kept = store.path.read_bytes()
    sensor.listen(300, gain=0.9, has_gate=False)
    assert store.path.read_bytes() == kept
    sensor.listen(300, gain=0.9, has_gate=False)
    assert store.path.read_bytes() != kept


def test_a_relearned_room_leaves_no_older_one_behind(store):
    sensor = Sensor(store)
    sensor.listen(40)
    sensor.watch.relearn()
    store.forget("the same, calibrated")
    assert not store.path.exists()
    assert sensor.listen(40, gain=0.1) is None
    assert str(arrays_of(store)["stream"]) == "the same, calibrated"


def test_echoes_of_other_bins_are_learned_again(store):
    Sensor(store).listen(40)
    arrays = arrays_of(store)
    echoes, floor = arrays["echoes"][:, :-1], arrays["floor"][:, :-1]
    np.savez(store.path, **{**arrays, "echoes": echoes, "floor": floor})
    sensor = Sensor(store)
    assert sensor.listen(40, gain=0.5) is None
    assert not sensor.watch.is_blind


def reference(**changes):
    values = {
        "echoes": np.array([[1 + 2j, 3], [0, -1j]]),
        "usable": np.array([True, False]),
        "noise_db": (-3.0, -2.5),
        "floor": FloorReference(np.array([1.0, np.inf]), np.array([2.0, np.inf]), 12.0),
    }
    return RoomReference(**{**values, **changes})


def test_all_of_it_comes_back(store):
    store.save(reference())
    back = store.load()
    assert np.array_equal(back.echoes, reference().echoes)
    assert back.usable.tolist() == [True, False]
    assert (back.noise_db, back.floor.t_s) == ((-3.0, -2.5), 12.0)
    assert np.array_equal(back.floor.first, [1, np.inf])
    assert np.array_equal(back.floor.kept, [2, np.inf])
    empty = np.zeros((0, 0), np.complex128)
    store.save(reference(echoes=empty, usable=np.zeros(0, bool), noise_db=None))
    back = store.load()
    assert len(back.usable) == 0
    assert back.noise_db is None


@pytest.mark.parametrize(
    "change",
    [
        {"echoes": np.full((2, 2), np.inf + 0j)},
        {"echoes": np.ones((2, 2))},
        {"usable": np.ones(3, np.bool_)},
        {"noise_db": np.ones(3)},
        {"floor": np.ones((1, 2))},
        {"floor": np.zeros((2, 2))},
        {"floor": np.float64(1)},
        {"calm_s": -1.0},
        {"calm_s": np.array(["x"], object)},
        *(b"", b"[" * 100_000, b"PK\x03\x04", b"\0"),
    ],
    ids=lambda change: str(change)[:40],
)
def test_a_file_that_makes_no_sense_counts_as_none(store, change, caplog):
    store.save(reference())
    if not isinstance(change, bytes):
        whole = io.BytesIO()
        np.savez(whole, **{**arrays_of(store), **change})
        change = whole.getvalue()
    store.path.write_bytes(change)
    assert store.load() is None
    assert "the room's reference is unreadable and not used" in caplog.text


def test_a_file_that_is_cut_or_flipped_raises_nothing(store):
    store.save(reference())
    whole = store.path.read_bytes()
    for k in range(0, len(whole), 7):
        store.path.write_bytes(whole[:k])
        assert store.load() is None
        store.path.write_bytes(whole[:k] + bytes([whole[k] ^ 0x55]) + whole[k + 1 :])
        store.load()


def test_a_disk_that_fails_is_told_once_and_is_no_end(tmp_path, caplog):
    (tmp_path / "file").write_text("")
    store = RoomStore(tmp_path / "file" / "radar.room.npz")
    for _ in range(3):
        store.save(reference())
    assert [r.levelno for r in caplog.records] == [logging.WARNING]
    store.forget("")
    assert "cannot be removed" in caplog.text
    (tmp_path / "file").unlink()
    store.save(reference())
    assert store.load() is not None


def test_a_reference_may_know_echoes_or_noise_alone():
    noise_alone = reference(usable=np.zeros(0, np.bool_), echoes=np.zeros((0, 0)))
    assert TamperWatch(SETTINGS, known=noise_alone).is_blind
    echoes_alone = TamperWatch(SETTINGS, known=reference(noise_db=None))
    assert not echoes_alone.is_blind
    assert echoes_alone.known.noise_db is None
    assert TamperWatch(SETTINGS, known=reference()).known.noise_db == (-3.0, -2.5)
    # A gate that has seen nothing tells of no interference.
    watch, gate = InterferenceWatch(6.0, 16.0, 1.0), Gate(GateSettings())
    assert watch.update(gate, dwell_of(noise(147).astype(np.complex64)), is_passed_over=True) == ""
    assert len(watch.reference.first) == 0
    # Without a file nothing is kept.
    store = RoomStore()
    store.save(reference())
    store.forget("")
    assert store.load() is None
