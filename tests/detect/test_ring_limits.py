"""Where the ring's rules begin and end: sizes, waits, what a fresh one says, and its times."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from radard.stream.ring import MAX_GAP_S, Dwell, DwellShape, FrameRing, Notice
from tests.radar_helpers import BASEBAND, copy_ring, frames_of, noise

RATE_HZ = 60.0


def dwell(n_slow=50, **fields):
    frames = np.zeros((n_slow, 4), np.complex64)
    return Dwell(frames, np.ones(n_slow, np.bool_), BASEBAND, RATE_HZ, 0.0, **fields)


def timed(samples, first_s, *, late_s=0.0):
    """Frames that arrive on the host's clock in time, the first at `first_s`, all so late."""
    for frame in frames_of(samples):
        yield replace(frame, t_mono_s=first_s + frame.index / RATE_HZ + late_s)


def until_waits(ring):
    """Wait until a thread waits for the ring."""
    end_s = time.monotonic() + 60
    while not ring._changed._waiters:
        assert time.monotonic() < end_s
        time.sleep(0.001)


def in_thread(work):
    """Start `work` in a thread; return the thread and the list that gets its result."""
    out = []
    thread = threading.Thread(target=lambda: out.append(work()), daemon=True)
    thread.start()
    return thread, out


def test_a_dwell_has_two_columns_at_least():
    shape = DwellShape.of(dwell_s=0.01, hop_s=1, frame_rate_hz=RATE_HZ, n_cpi=4)
    assert shape.n_slow == 2 + 4 - 1


def test_a_dwell_of_its_own_is_whole_and_of_no_stream():
    alone = dwell()
    assert (alone.n_lost, alone.longest_gap_s, alone.t_mono_s, alone.end_frame) == (0, 0, 0, 0)
    assert alone.is_whole


@pytest.mark.parametrize(
    ("n_lost", "gap_s", "is_whole"),
    [
        (1, 0.02, True),
        (2, 0.02, False),
        (1, MAX_GAP_S, True),
        (1, MAX_GAP_S + 1e-9, True),
        (1, MAX_GAP_S + 2e-9, False),
    ],
)
def test_two_percent_and_fifty_milliseconds_may_be_missing(n_lost, gap_s, is_whole):
    assert dwell(50, n_lost=n_lost, longest_gap_s=gap_s).is_whole is is_whole


@pytest.mark.parametrize(
    ("lost", "longest"), [((), 0), ((1, 2, 5), 2), ((1, 5, 6, 7), 3), ((1, 8, 9), 2), ((9,), 1)]
)
def test_the_longest_gap_is_found_wherever_it_lies(lost, longest):
    ring, missing = copy_ring(10, RATE_HZ, hop_s=100.0), 0
    for frame in frames_of(noise(11)):
        if frame.index in lost:
            missing += 1
            continue
        ring.push(replace(frame, lost=missing))
        missing = 0
    assert ring.next_item(0).longest_gap_s == pytest.approx(longest / RATE_HZ)


def test_a_fresh_ring_says_that_there_is_nothing():
    ring = copy_ring(10, RATE_HZ)
    recent = ring.recent()
    assert (len(recent.frames), recent.end_frame, recent.begun_at, recent.t_s) == (0, 0, 0, 0)
    assert ring.due_s() == np.inf
    assert ring.axis is BASEBAND
    assert ring.frame_rate_hz == RATE_HZ
    ring.post("silent", "nothing comes")
    assert ring.next_item(0) == Notice("silent", "nothing comes", 0.0)


@pytest.mark.parametrize(
    ("rate_hz", "hop_s", "n_rows"), [(4.0, 1.0, 10 + 2 * 4 + 8), (1.0, 1.0, 10 + 2 + 8)]
)
def test_a_viewer_finds_a_dwell_two_hops_and_eight_rows(rate_hz, hop_s, n_rows):
    ring = copy_ring(10, rate_hz, hop_s)
    ring.recent()
    samples = noise(100)
    for frame in frames_of(samples):
        ring.push(frame)
        while ring._queue:
            ring.next_item(0)
        # Slow frames wait for no others while somebody looks on.
        assert ring.recent(frame.index).end_frame == frame.index + 1
    assert np.array_equal(ring.recent().frames, samples[-n_rows:])


def test_a_writer_may_be_all_rows_ahead_and_no_further():
    ring = copy_ring(3, 1.0, hop_s=100.0)
    frames = list(frames_of(noise(300)))
    n_rows = 3 + 2 * 100 + 8
    for frame in frames[: n_rows + 1]:
        assert ring.push(frame) is True
    # Frames of another kind are not put beside those that wait, which find no place.
    real = replace(frames[n_rows + 1], samples=np.zeros(64, np.float32))
    thread, out = in_thread(lambda: ring.push(real))
    until_waits(ring)
    ring.stop()
    thread.join(60)
    assert out == [False]
    assert ring.push(replace(real, lost=1)) is False
    assert ring.push(real) is False


def test_a_writer_that_waits_for_its_rows_is_told_of_the_stop():
    ring, pushed = copy_ring(3, 1.0, hop_s=100.0), []

    def push():
        for frame in frames_of(noise(300)):
            pushed.append(ring.push(frame))
            if pushed[-1] is not True:
                return

    thread, _ = in_thread(push)
    until_waits(ring)
    n = len(pushed)
    ring.stop()
    thread.join(60)
    assert pushed == [True] * n + [False]


@pytest.mark.parametrize("kind", ["post", "end", "dwell"])
def test_a_waiting_worker_is_woken(kind):
    ring = copy_ring(3, RATE_HZ)
    thread, out = in_thread(lambda: ring.next_item(60))
    until_waits(ring)
    if kind == "post":
        ring.post("silent", "")
    elif kind == "end":
        ring.end()
    else:
        for frame in frames_of(noise(3)):
            ring.push(frame)
    thread.join(60)
    (item,) = out
    assert type(item) is {"post": Notice, "end": type(None), "dwell": Dwell}[kind]


def test_for_two_seconds_after_a_look_frames_come_by_threes():
    sizes = []

    def convert(samples, out):
        sizes.append(len(samples))
        out[...] = samples

    shape = DwellShape(n_slow=1000, hop_s=1.0, frame_rate_hz=RATE_HZ)
    ring = FrameRing(BASEBAND, convert, shape)
    ring.recent()
    for frame in frames_of(noise(400)):
        ring.push(frame)
    # The last of them find two waiting.
    assert sizes == [3] * 39 + [64] * 4


def test_frames_of_another_kind_keep_their_rows():
    samples = noise(20)
    samples[10:].imag = 0
    ring = copy_ring(20, RATE_HZ)
    for frame in frames_of(samples):
        real = frame.samples.real.astype(np.float32)
        ring.push(replace(frame, samples=real) if frame.index >= 10 else frame)
    assert np.array_equal(ring.next_item(0).frames, samples)


def test_frames_of_one_bin():
    axis = replace(BASEBAND, n_range=1)
    shape = DwellShape(n_slow=4, hop_s=1.0, frame_rate_hz=RATE_HZ)
    ring = FrameRing(axis, lambda samples, out: np.copyto(out, samples), shape)
    samples = np.arange(4, dtype=np.float32)[:, None]
    for frame in frames_of(samples, axis):
        ring.push(frame)
    assert np.array_equal(ring.next_item(0).frames, samples)


def test_a_first_frame_that_is_not_finite_is_an_empty_row():
    samples = noise(10)
    samples[0, 0] = np.nan
    ring = copy_ring(10, RATE_HZ)
    for frame in frames_of(samples):
        ring.push(frame)
    got = ring.next_item(0)
    assert not got.frames[0].any()
    assert got.valid.tolist() == [False] + [True] * 9


def test_a_gap_of_a_whole_hop_leaves_the_schedule_as_it_is():
    """Where a hop is no whole number of frames, dwells still come once a second."""
    ring, missing, ends = copy_ring(41, 17.5), 0, []
    for frame in frames_of(noise(160)):
        if frame.index == 17:
            missing = 1
            continue
        ring.push(replace(frame, lost=missing))
        missing = 0
        while ring._queue:
            ends.append(ring.next_item(0).end_frame)
    assert ends == [41 + round(17.5 * k) for k in range(len(ends))]
    assert len(ends) > 5


def test_hops_of_half_a_second_and_what_a_notice_says_of_the_time():
    ring, ends = copy_ring(10, RATE_HZ, hop_s=0.5), []
    for frame in frames_of(noise(100)):
        ring.push(frame)
        while ring._queue:
            ends.append(ring.next_item(0).end_frame)
    assert ends == [10, 40, 70, 100]
    ring.post("silent", "")
    assert ring.next_item(0).t_s == pytest.approx(100 / RATE_HZ)


def test_frames_that_wait_are_shown_when_the_stream_begins_again():
    ring = copy_ring(147, RATE_HZ)
    for frame in frames_of(noise(11)):
        ring.push(replace(frame, restarted=frame.index == 10))
    recent = ring.recent()
    assert (recent.begun_at, recent.end_frame) == (10, 10)


@pytest.mark.parametrize("n_before", [0, 10])
def test_what_was_lost_before_a_stream_begins_is_not_counted(n_before):
    ring = copy_ring(147, RATE_HZ)
    for frame in frames_of(noise(n_before + 1)):
        is_last = frame.index == n_before
        list(ring.items(replace(frame, lost=5 * is_last, restarted=is_last and n_before > 0)))
    assert ring._taken == n_before + 1


@pytest.mark.parametrize("lost", [4, 5, 6])
def test_a_lost_row_repeats_the_one_before_it_wherever_it_lies(lost):
    """Frames are converted a few at a time: here three, behind them four."""
    ring, samples = copy_ring(3, 4.0), noise(12)
    for frame in frames_of(samples):
        if frame.index != lost:
            ring.push(replace(frame, lost=int(frame.index == lost + 1)))
    dwells = [ring.next_item(0), ring.next_item(0)]
    want = samples.copy()
    want[lost] = want[lost - 1]
    assert np.array_equal(dwells[1].frames, want[4:7])


# ---------------------------------------------------------------- times


def test_the_next_dwell_is_due_when_its_last_frame_arrives():
    ring = copy_ring(30, RATE_HZ)
    for frame in timed(noise(20), 100.0):
        # A frame that its reader found late says nothing.
        ring.push(replace(frame, t_mono_s=frame.t_mono_s + 0.1 * (frame.index % 3 > 0)))
    assert ring.due_s() == pytest.approx(100 + 29 / RATE_HZ)
    for frame in list(timed(noise(40), 100.0))[20:]:
        ring.push(frame)
    assert ring.due_s() == pytest.approx(100 + 89 / RATE_HZ)


def test_a_clock_that_runs_apart_is_followed_within_two_hops():
    ring = copy_ring(30, RATE_HZ)
    for frame in timed(noise(400), 100.0):
        ring.push(replace(frame, t_mono_s=frame.t_mono_s + 0.01 * (frame.index >= 100)))
        while ring._queue:
            ring.next_item(0)
    assert ring.due_s() == pytest.approx(100.01 + (30 + 60 * 7 - 1) / RATE_HZ)


def test_after_a_restart_the_old_times_do_not_count():
    ring = copy_ring(30, RATE_HZ)
    for frame in timed(noise(20), 100.0):
        late_s = 5.0 * (frame.index >= 10)
        ring.push(replace(frame, t_mono_s=frame.t_mono_s + late_s, restarted=frame.index == 10))
    assert ring.due_s() == pytest.approx(105 + 39 / RATE_HZ)


@pytest.mark.parametrize("way", ["push", "items"])
def test_a_dwell_that_ends_with_a_lost_frame_has_no_time_of_arrival(way):
    ring = copy_ring(10, RATE_HZ)
    got = []
    for frame in timed(np.delete(noise(11), 9, axis=0), 100.0):
        frame = replace(frame, lost=int(frame.index == 9))  # noqa: PLW2901 - one number on
        if way == "push":
            ring.push(frame)
        else:
            got += ring.items(frame)
    got = got or [ring.next_item(0)]
    assert got[0].t_mono_s == 0.0
    assert got[0].n_lost == 1
