"""Play, pause, seek and speed of a replay."""

import itertools
import time

import pytest

from radard.stream.playback import Playback
from radard.stream.source import open_source
from tests.alarm_helpers import write_recording
from tests.radar_helpers import noise


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "r.h5"
    write_recording(path, noise(600))
    return path


def test_a_pause_holds_and_says_so():
    reminders, changes = [], []
    playback = Playback(10.0, None, lambda: reminders.append(1))
    playback.on_change = lambda: changes.append(1)
    playback.play(is_playing=False)
    assert not playback.state["is_playing"]
    assert playback.wait_s(1.0) > 0
    assert playback.wait_s(1.0) > 0
    assert len(reminders) == 2
    playback.play()
    assert playback.wait_s(1.0) == 0
    assert (len(reminders), len(changes)) == (2, 2)


def test_a_seek_wakes_a_pause_and_is_told_once():
    playback = Playback(10.0, 1.0)
    playback.play(is_playing=False)
    playback.seek(4.0)
    assert playback.state["position_s"] == 4.0
    assert (playback.wait_s(1.0), playback.take_seek()) == (0.0, 4.0)
    playback.play()
    assert (playback.wait_s(4.0), playback.take_seek()) == (0.0, None)


def test_closing_ends_a_pause():
    playback = Playback(10.0, 0.25)
    playback.play(is_playing=False)
    assert playback.wait_s(0.0) > 0
    playback.close()
    assert playback.wait_s(0.0) == 0


def test_the_next_round_of_a_loop_is_paced_as_well(monkeypatch):
    now = [100.0]
    playback = Playback(10.0, 1.0)
    monkeypatch.setattr("radard.stream.playback.time.monotonic", lambda: now[0])
    for position_s in (0.0, 5.0, 9.9, 0.0, 5.0, 9.9):
        now[0] += playback.wait_s(position_s)
        assert playback.due_s == pytest.approx(now[0])
    assert now[0] == pytest.approx(100 + 2 * 9.9)


def test_a_round_that_is_read_late_follows_on_the_last_all_the_same(monkeypatch):
    now = [100.0]
    playback = Playback(10.0, 2.0)
    monkeypatch.setattr("radard.stream.playback.time.monotonic", lambda: now[0])
    playback.begin_s = 101.0
    assert playback.wait_s(0.0) == pytest.approx(1.0)
    now[0] = 110.0
    assert (playback.wait_s(9.8), playback.due_s) == (0.0, pytest.approx(105.9))
    assert (playback.wait_s(0.0), playback.due_s) == (0.0, pytest.approx(105.9))
    assert (playback.wait_s(8.0), playback.due_s) == (0.0, pytest.approx(109.9))


def test_a_frame_that_is_read_late_was_due_when_it_should_have_come(recording):
    source = open_source(f"replay:{recording}", speed="8")
    items = source.items()
    first = next(items)
    time.sleep(0.5)
    frames = list(itertools.takewhile(lambda item: not isinstance(item, float), items))
    # Of four seconds, all that was due, by the clock and not by the reader; then it says so.
    assert len(frames) > 200
    last = frames[-1]
    assert last.t_mono_s - first.t_mono_s == pytest.approx(last.index / 60 / 8, abs=0.11)
    assert 0 < next(items) <= 0.1
    source.close()


def test_a_replay_follows_its_controls(recording):
    source = open_source(f"replay:{recording}", speed="max")
    frames = source.frames()
    assert [next(frames).index for _ in range(3)] == [0, 1, 2]
    source.playback.seek(5.0)
    moved = next(frames)
    assert (moved.index, moved.restarted, moved.lost) == (300, True, 0)
    after = next(frames)
    assert (after.index, after.restarted) == (301, False)
    source.close()
    assert list(frames) == []
