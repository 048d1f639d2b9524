"""The ring: frames in, dwells out; gaps, restarts, threads, who looks on, when dwells are due."""

import contextlib
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.downconvert import DownConverter
from radard.errors import FeatureError
from radard.judge.features import FeatureSettings
from radard.stream.ring import MAX_GAP_S, Dwell, DwellShape, FrameRing, Notice
from tests.radar_helpers import BASEBAND, copy_ring, frames_of, lossy, noise
from tests.sim_helpers import RF


def dwells(ring, frames):
    """Push from a thread and collect copies of all dwells and notices."""

    def push():
        for frame in frames:
            if not ring.push(frame):
                break
        ring.end()

    thread = threading.Thread(target=push)
    thread.start()
    out = []
    while (item := ring.next_item(60)) is not None:
        out.append(replace(item, frames=item.frames.copy()) if isinstance(item, Dwell) else item)
    thread.join()
    return out


def test_shape_counts_columns_and_cpi():
    assert FeatureSettings().dwell_shape(1.0, 60.0).n_slow == 147
    assert FeatureSettings(n_cpi=8).dwell_shape(1.0, 17.06).n_slow == 41


def schedule(good, n_slow, hop):
    """Where dwells end: every hop, but behind a gap with the first frames that are whole."""
    ends, end = [], n_slow
    while end <= len(good):
        ends.append(end)
        window = good[end - n_slow : end]
        lost = np.flatnonzero(~window)
        runs = "".join(" x"[not here] for here in window).split()
        longest_s = max((len(run) for run in runs), default=0) / hop
        is_whole = len(lost) <= 0.02 * n_slow and longest_s <= 0.05 + 1e-9
        first = lost[-1] + 1 if len(lost) else hop
        end += int(hop if is_whole else min(hop, first))
    return ends


@pytest.mark.parametrize("end", range(300, 420))
def test_behind_a_gap_of_a_second_a_decision_comes_within_a_dwell(end):
    """Wherever in a hop the gap ends: 2.45 s later, not up to 3.45 s."""
    got = dwells(copy_ring(147, 60), lossy(noise(800), set(range(end - 60, end))))
    whole = next(d for d in got if d.t_s * 60 > end and d.is_whole)
    assert round(whole.t_s * 60) - end in {144, 145, 146, 147}


def test_in_one_thread_a_long_gap_gives_the_same_dwells():
    frames = [replace(f, lost=700 * (f.index == 200)) for f in frames_of(noise(400))]
    alone, ring = [], copy_ring(147, 60)

    def both():
        for frame in frames:
            alone.extend((item.t_s, item.n_lost) for item in ring.items(frame))

    # On a thread that ends with the process: it must not wait for itself.
    thread = threading.Thread(target=both, daemon=True)
    thread.start()
    thread.join(60)
    assert not thread.is_alive()
    assert alone == [(item.t_s, item.n_lost) for item in dwells(copy_ring(147, 60), frames)]
    assert max(n_lost for _, n_lost in alone) == 147


def test_the_writer_waits_for_a_slow_worker_and_overwrites_nothing():
    samples = noise(60 * 20)
    ring = copy_ring(147, 60)
    thread = threading.Thread(
        target=lambda: ([ring.push(f) for f in frames_of(samples)], ring.end())
    )
    thread.start()
    thread.join(0.2)
    assert thread.is_alive()
    k = 0
    while (dwell := ring.next_item(5)) is not None:
        assert np.array_equal(dwell.frames, samples[60 * k : 60 * k + 147])
        k += 1
    assert k == 18
    thread.join()


def test_waiting_for_an_item_has_an_end():
    with pytest.raises(TimeoutError):
        copy_ring(147, 60).next_item(0.01)


@settings(deadline=None, derandomize=True, max_examples=40)
@given(
    n_slow=st.integers(2, 200),
    rate=st.integers(1, 90),
    lost=st.sets(st.integers(1, 399), max_size=40),
    bad=st.sets(st.integers(0, 399), max_size=10),
)
def test_frames_converted_together_are_those_converted_alone(n_slow, rate, lost, bad):
    samples = noise(400, 6).real.astype(np.float32)
    samples[list(bad), 2] = np.nan
    converter = DownConverter(replace(RF, n_range=6), 2)
    shape, are_numbers = DwellShape(n_slow=n_slow, hop_s=1.0, frame_rate_hz=rate), []

    def convert(frames, out):
        are_numbers.append(np.isfinite(frames).all())
        converter.convert(frames, out)

    ring = FrameRing(converter.axis, convert, shape)
    got = [d for d in dwells(ring, lossy(samples, lost)) if isinstance(d, Dwell)]
    good = np.array([k not in lost | bad for k in range(400)])
    rows = np.zeros((400, 3), np.complex64)
    for k in range(400):
        if good[k]:
            rows[k] = converter.convert(samples[k])
        elif k:
            rows[k] = rows[k - 1]
    # Nobody knows of frames that are lost behind the last one.
    last = max(set(range(400)) - lost)
    ends = schedule(good[: last + 1], n_slow, rate)
    assert [round(d.t_s * rate) for d in got] == ends
    for dwell, end in zip(got, ends, strict=True):
        assert np.array_equal(dwell.frames, rows[end - n_slow : end])
        assert np.array_equal(dwell.valid, good[end - n_slow : end])
    assert all(are_numbers)


def test_a_frame_of_another_length_is_refused():
    converter = DownConverter(RF, 8)
    ring = FrameRing(
        converter.axis, converter.convert, DwellShape(n_slow=3, hop_s=1.0, frame_rate_hz=3.0)
    )
    first, second, third = frames_of(noise(3, RF.n_range).real.astype(np.float32), RF)
    ring.push(first)
    ring.push(second)
    with pytest.raises(FeatureError, match="a frame of 5 bins in a stream of 768"):
        ring.push(replace(third, samples=third.samples[:5]))


def test_who_looks_on_sees_rows_that_are_whole_and_soon_the_newest():
    samples = noise(400)
    ring = copy_ring(147, 60)
    seen, late = 0, []
    for frame in frames_of(samples):
        ring.push(frame)
        with contextlib.suppress(TimeoutError):
            ring.next_item(0)
        recent = ring.recent(seen)
        assert np.array_equal(recent.frames, samples[seen : recent.end_frame])
        assert recent.valid.all()
        assert recent.begun_at == 0
        assert recent.t_s == pytest.approx(recent.end_frame / 60)
        seen = recent.end_frame
        late.append(frame.index + 1 - seen)
    # At first nobody had looked; then a frame waits for two others.
    assert max(late[64:]) <= 3
    whole = ring.recent()
    assert len(whole.frames) == min(seen, ring._capacity - (400 - seen))


def test_who_looks_on_after_a_restart_sees_the_new_stream_only():
    samples = noise(200)
    ring = copy_ring(147, 60)
    ring.recent()
    for frame in frames_of(samples):
        ring.push(replace(frame, restarted=frame.index == 100))
    recent = ring.recent(20)
    assert recent.begun_at == 100
    assert np.array_equal(recent.frames, samples[100 : recent.end_frame])
    # Frames that wait are shown when the stream begins again.
    ring = copy_ring(147, RATE_HZ)
    for frame in frames_of(noise(11)):
        ring.push(replace(frame, restarted=frame.index == 10))
    recent = ring.recent()
    assert (recent.begun_at, recent.end_frame) == (10, 10)


RATE_HZ = 60.0


def alone(n_slow=50, **fields):
    frames = np.zeros((n_slow, 4), np.complex64)
    return Dwell(frames, np.ones(n_slow, np.bool_), BASEBAND, RATE_HZ, 0.0, **fields)


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
    shape = FeatureSettings(dwell_s=0.01, n_cpi=4).dwell_shape(1.0, RATE_HZ)
    assert shape.n_slow == 2 + 4 - 1
    # A dwell of its own is whole and of no stream.
    one = alone()
    assert (one.n_lost, one.longest_gap_s, one.t_mono_s, one.end_frame) == (0, 0, 0, 0)
    assert one.is_whole


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
    assert alone(50, n_lost=n_lost, longest_gap_s=gap_s).is_whole is is_whole


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


def test_what_is_left_until_the_next_dwell_and_that_it_is_told():
    ring, frames, left, told = copy_ring(10, 4.0), list(frames_of(noise(23))), [], []
    ring.on_item = lambda: told.append(type(ring.next_item(0)))
    for frame in frames:
        if frame.index == 14:
            ring.recent()
        left.append(ring.n_left)
        ring.push(frame)
    ring.end()
    # Who looks on waits for each frame, for two seconds.
    assert left == [1, *range(9, 0, -1), 4, 3, 2, 1, *[1] * 8, 4]
    assert told == [Dwell] * 4 + [type(None)]
    ends = [dwell.end_frame for dwell in copy_ring(10, 4.0).dwells(frames)]
    assert ends == [10, 14, 18, 22]


def test_frames_of_another_kind_keep_their_rows():
    samples = noise(20)
    samples[10:].imag = 0
    ring = copy_ring(20, RATE_HZ)
    for frame in frames_of(samples):
        real = frame.samples.real.astype(np.float32)
        ring.push(replace(frame, samples=real) if frame.index >= 10 else frame)
    assert np.array_equal(ring.next_item(0).frames, samples)
    # Frames of one bin.
    axis = replace(BASEBAND, n_range=1)
    shape = DwellShape(n_slow=4, hop_s=1.0, frame_rate_hz=RATE_HZ)
    ring = FrameRing(axis, lambda samples, out: np.copyto(out, samples), shape)
    samples = np.arange(4, dtype=np.float32)[:, None]
    for frame in frames_of(samples, axis):
        ring.push(frame)
    assert np.array_equal(ring.next_item(0).frames, samples)


def test_a_gap_of_a_whole_hop_leaves_the_schedule_as_it_is():
    """Where a hop is no whole number of frames, dwells still come once a second."""
    ends = [d.end_frame for d in dwells(copy_ring(41, 17.5), lossy(noise(160), {17}))]
    assert ends == [41 + round(17.5 * k) for k in range(len(ends))]
    assert len(ends) > 5
    # Hops of half a second and what a notice says of the time.
    ring = copy_ring(10, RATE_HZ, hop_s=0.5)
    ends = [item.end_frame for frame in frames_of(noise(100)) for item in ring.items(frame)]
    assert ends == [10, 40, 70, 100]
    ring.post("silent", "")
    assert ring.next_item(0).t_s == pytest.approx(100 / RATE_HZ)


def timed(samples, first_s):
    """Frames that arrive on the host's clock in time, the first at `first_s`."""
    for frame in frames_of(samples):
        yield replace(frame, t_mono_s=first_s + frame.index / RATE_HZ)


def test_the_next_dwell_is_due_when_its_last_frame_arrives():
    ring = copy_ring(30, RATE_HZ)
    for frame in timed(noise(20), 100.0):
        # A frame that its reader found late says nothing.
        ring.push(replace(frame, t_mono_s=frame.t_mono_s + 0.1 * (frame.index % 3 > 0)))
    assert ring.due_s() == pytest.approx(100 + 29 / RATE_HZ)
    for frame in list(timed(noise(40), 100.0))[20:]:
        ring.push(frame)
    assert ring.due_s() == pytest.approx(100 + 89 / RATE_HZ)
    # A clock that runs apart is followed within two hops.
    ring = copy_ring(30, RATE_HZ)
    for frame in timed(noise(400), 100.0):
        ring.push(replace(frame, t_mono_s=frame.t_mono_s + 0.01 * (frame.index >= 100)))
        while ring._queue:
            ring.next_item(0)
    assert ring.due_s() == pytest.approx(100.01 + (30 + 60 * 7 - 1) / RATE_HZ)
    # After a restart the old times do not count.
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
