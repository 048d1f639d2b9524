"""Pictures of the dashboard: frames to columns, columns to bytes, and who makes them when."""

import logging
import struct
import threading

import numpy as np
import pytest

from radard.dsp.pictures import GAIT_S, Spectrograms
from radard.web.pictures.picture_thread import PictureThread
from radard.web.pictures.wire import TIMED, encode_columns, encode_gait
from tests.radar_helpers import BASEBAND, copy_ring, frames_of, noise, walker
from tests.waiting import wait_for

RATE_HZ = 60.0
HEAD = struct.Struct("<BBHIIfd")


def made(frames, *, cut=8, valid=None, rate_hz=RATE_HZ):
    """All columns of some frames, pushed `cut` at a time."""
    spectrograms = Spectrograms(BASEBAND, rate_hz)
    valid = np.ones(len(frames), np.bool_) if valid is None else valid
    found = []
    for at in range(0, len(frames), cut):
        rows = frames[at : at + cut]
        columns = spectrograms.push(rows, valid[at : at + cut], (at + len(rows)) / rate_hz)
        if columns is not None:
            found.append(columns)
    return spectrograms, found


def joined(found, name):
    return np.concatenate([c.values[name] for c in found], axis=1)


def test_a_walker_is_where_and_as_fast_as_it_is():
    n_slow = 240
    frames = noise(n_slow, seed=1)
    frames += walker(n_slow, RATE_HZ, speed_mps=0.5, start_m=2.3, level=30.0)
    spectrograms, found = made(frames)
    _, quiet = made(noise(n_slow, seed=1))
    by_name = {p.name: p for p in spectrograms.pictures}
    n = joined(found, "range").shape[1]
    times_s = found[-1].t_s - spectrograms.column_s * np.arange(n)[::-1]
    for name, wanted in (("range", 2.3 - 0.5 * times_s), ("velocity", 0.5)):
        picture = by_name[name]
        strongest = picture.first + picture.step * joined(found, name).argmax(axis=0)
        off = np.abs(strongest - wanted)
        assert np.median(off) <= picture.step
        assert np.mean(off <= 2 * picture.step) > 0.9
        # Noise alone is dark.
        assert joined(quiet, name).mean() < 25
    picture = spectrograms.gait()
    assert picture.shape == (28, round(GAIT_S / spectrograms.column_s) // 2)
    # It needs two seconds, and leaves out the mean.
    assert (picture[:, 0] == 0).all()
    assert made(frames[:90])[0].gait() is None


@pytest.mark.parametrize("speed_mps", [0.3, 0.8, 1.2, 1.7])
def test_one_body_is_one_band_also_faster_than_the_frames_tell(speed_mps):
    n_slow = round(1.7 / speed_mps * RATE_HZ)
    frames = noise(n_slow, seed=1)
    frames += walker(n_slow, RATE_HZ, speed_mps=speed_mps, start_m=2.4, level=30.0)
    spectrograms, found = made(frames)
    picture = spectrograms.pictures[1]
    velocities = picture.first + picture.step * np.arange(picture.n_rows)
    # The first half second has no line to go by.
    seen = joined(found, "velocity")[:, 4:]
    assert np.abs(velocities[seen.argmax(axis=0)] - speed_mps).max() <= 1.5 * picture.step
    assert seen[np.abs(velocities - speed_mps) > 0.4].max() < 60


@pytest.mark.parametrize("rate_hz", [17.0, 60.0, 200.0])
def test_columns_come_at_a_steady_rate_however_frames_are_cut(rate_hz):
    frames = noise(round(6 * rate_hz), seed=3)
    spectrograms, one = made(frames, cut=1, rate_hz=rate_hz)
    _, many = made(frames, cut=31, rate_hz=rate_hz)
    n_one, n_many = (joined(found, "range").shape[1] for found in (one, many))
    assert n_one == n_many
    assert n_one == pytest.approx((6 - 28 / 60) / spectrograms.column_s, abs=2)
    assert one[-1].t_s == pytest.approx(many[-1].t_s)
    assert 6 - one[-1].t_s <= 0.24 + 2 * spectrograms.column_s


def test_lost_frames_are_marked():
    valid = np.ones(240, np.bool_)
    valid[100] = False
    _, found = made(noise(240, seed=4), valid=valid)
    flags = np.concatenate([c.valid for c in found])
    assert not flags.all()
    assert flags[-10:].all()


def test_bytes_hold_what_the_page_reads():
    spectrograms, found = made(noise(120, seed=7))
    columns = found[-1]
    data = encode_columns(columns, first=9, epoch=3, column_s=spectrograms.column_s)
    kind, n_pictures, n, first, epoch, column_s, t_s = HEAD.unpack_from(data)
    assert (kind, n_pictures, n, first, epoch) == (1, 3, len(columns.valid), 9, 3)
    assert (column_s, t_s) == (pytest.approx(spectrograms.column_s), columns.t_s)
    values = [columns.values[name].T.ravel() for name in TIMED]
    told = np.frombuffer(data, np.uint8, offset=HEAD.size)
    np.testing.assert_array_equal(told, np.concatenate([columns.valid, *values]))
    gait = encode_gait(np.arange(6, dtype=np.uint8).reshape(2, 3), epoch=1, step_hz=0.5, t_s=4.0)
    assert HEAD.unpack_from(gait) == (2, 0, 3, 2, 1, 0.5, 4.0)
    assert list(gait[HEAD.size :]) == [0, 3, 1, 4, 2, 5]


def fed_ring():
    """A ring whose dwells are taken."""
    ring = copy_ring(60, RATE_HZ)
    threading.Thread(target=lambda: [*iter(ring.next_item, None)], daemon=True).start()
    return ring


@pytest.fixture
def picture_thread():
    """A function that makes picture threads of a ring: with axes and columns that they told."""
    made = []

    def build(ring):
        axes, data = [], []
        made.append(PictureThread(ring, axes.append, data.append))
        return made[-1], axes, data

    yield build
    for each in made:
        each.close()


def test_a_page_gets_the_last_half_minute_and_nobody_gets_pictures(picture_thread):
    ring = fed_ring()
    one, axes, data = picture_thread(lambda: ring)
    for k, frame in enumerate(frames_of(noise(45 * 60, seed=9))):
        ring.push(frame)
        if k % 60 == 59:
            # As its thread does, a second of stream at a time.
            one._look(None)
    assert (axes, data) == ([], [])
    one.start()
    one.want(is_wanted=True)
    wait_for(lambda: len(data) >= 30)
    heads = [HEAD.unpack_from(each) for each in data]
    kinds, n, t_s = zip(*((h[0], h[2], h[6]) for h in heads), strict=True)
    assert len(axes) == 1
    assert t_s[-1] == pytest.approx(45, abs=2)
    assert sum(n[i] for i, kind in enumerate(kinds) if kind == 1) == pytest.approx(30 * 15, abs=20)
    one.want(is_wanted=False)
    one.want(is_wanted=True)
    wait_for(lambda: len(axes) == 2)
    ring.end()


def test_a_picture_thread_survives_what_goes_wrong(picture_thread, monkeypatch, caplog):
    ring, faults = fed_ring(), [RuntimeError("no ring today")]

    def broken():
        if faults:
            raise faults.pop()
        return ring

    one, _, data = picture_thread(broken)
    monkeypatch.setattr("radard.web.pictures.picture_thread._AFTER_FAULT_S", 0.0)
    # Another test's late thread may set up logging again, and take away what the root logger has.
    caplog.set_level(logging.ERROR, "radard")
    monkeypatch.setattr(logging.getLogger("radard"), "handlers", [caplog.handler])
    one.want(is_wanted=True)
    one.start()
    for frame in frames_of(noise(300, seed=9)):
        ring.push(frame)
    wait_for(lambda: data)
    ring.end()
    assert "a picture could not be made" in caplog.text
