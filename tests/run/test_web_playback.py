"""Play, pause, seek and speed of a replay."""

import threading
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


def test_without_commands_frames_pass_at_once():
    playback = Playback(10.0, None)
    assert [playback.pace(k / 60) for k in range(600)] == [None] * 600
    assert playback.state.position_s == pytest.approx(599 / 60)


def test_a_pause_holds_and_says_so():
    reminders = threading.Event()
    playback = Playback(10.0, None, reminders.set)
    playback.pause()
    passed = threading.Event()
    thread = threading.Thread(target=lambda: (playback.pace(1.0), passed.set()))
    thread.start()
    assert reminders.wait(60)
    assert not passed.is_set()
    assert not playback.state.is_playing
    playback.play()
    assert passed.wait(60)
    thread.join()


def test_a_seek_wakes_a_pause_and_is_told_once():
    playback = Playback(10.0, 1.0)
    playback.pause()
    playback.seek(4.0)
    assert playback.state.position_s == 4.0
    assert playback.pace(1.0) == 4.0
    playback.play()
    assert playback.pace(4.0) is None


def test_closing_frees_the_reader():
    playback = Playback(10.0, 0.25)
    playback.pause()
    thread = threading.Thread(target=playback.pace, args=(0.0,))
    thread.start()
    playback.close()
    thread.join(60)
    assert not thread.is_alive()


@pytest.mark.parametrize("value", [0.0, 0.2, 65.0, -1.0, float("nan"), float("inf")])
def test_impossible_speeds(value):
    with pytest.raises(ValueError, match="speed"):
        Playback(10.0, 1.0).set_speed(value)


@pytest.mark.parametrize("value", [-0.1, 10.0, float("nan"), float("inf")])
def test_impossible_positions(value):
    with pytest.raises(ValueError, match="position"):
        Playback(10.0, 1.0).seek(value)


def test_the_next_round_of_a_loop_is_paced_as_well(monkeypatch):
    now = [100.0]
    playback = Playback(10.0, 1.0)
    monkeypatch.setattr("radard.stream.playback.time.monotonic", lambda: now[0])

    def wait(wait_s):
        now[0] += wait_s

    monkeypatch.setattr(playback._changed, "wait", wait)
    for position_s in (0.0, 5.0, 9.9, 0.0, 5.0, 9.9):
        playback.pace(position_s)
    assert now[0] == pytest.approx(100 + 2 * 9.9)


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


def test_a_replay_that_nobody_touches_is_what_it_was(recording):
    frames = list(open_source(f"replay:{recording}?start=2", speed="max").frames())
    assert [f.index for f in frames] == list(range(120, 600))
    assert not any(f.restarted for f in frames[1:])
    assert {f.t_mono_s for f in frames} == {0.0}
    looped = open_source(f"replay:{recording}?loop=1", speed="max").frames()
    indices = [next(looped).index for _ in range(1000)]
    assert indices == list(range(1000))


def test_speed_changes_take_hold_while_it_waits(recording):
    source = open_source(f"replay:{recording}", speed="0.25")
    frames = source.frames()
    next(frames)
    begun_s = time.monotonic()
    thread = threading.Timer(0.1, source.playback.set_speed, (None,))
    thread.start()
    for _ in range(599):
        next(frames)
    assert time.monotonic() - begun_s < 20
    thread.join()
    source.close()
