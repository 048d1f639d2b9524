import contextlib
import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.dsp.downconvert import DownConverter
from radard.errors import FeatureError
from radard.stream.ring import Dwell, DwellShape, FrameRing, Notice
from tests.radar_helpers import copy_ring, frames_of, noise
from tests.receiver_helpers import RF


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
    shape = DwellShape.of(dwell_s=2, hop_s=1, frame_rate_hz=60, n_cpi=28)
    assert shape.n_slow == 147
    assert DwellShape.of(dwell_s=2, hop_s=1, frame_rate_hz=17.06, n_cpi=8).n_slow == 41


def test_first_dwell_after_147_frames_then_every_second():
    samples = noise(60 * 6)
    got = dwells(copy_ring(147, 60), frames_of(samples))
    assert [round(d.t_s, 3) for d in got] == [2.45, 3.45, 4.45, 5.45]
    for k, dwell in enumerate(got):
        assert np.array_equal(dwell.frames, samples[60 * k : 60 * k + 147])
        assert dwell.valid.all()
        assert dwell.is_whole


def lossy(samples, lost):
    """Frames of `samples` without those in `lost`."""
    missing = 0
    for frame in frames_of(samples):
        if frame.index in lost:
            missing += 1
            continue
        yield replace(frame, lost=missing)
        missing = 0


def test_lost_frames_are_marked_and_time_goes_on():
    samples = noise(300)
    got = dwells(copy_ring(147, 60), lossy(samples, {50, 51, 200}))
    assert [round(d.t_s, 3) for d in got] == [2.45, 3.45, 4.45]
    assert [d.n_lost for d in got] == [2, 1, 1]
    assert not got[0].valid[50]
    assert np.array_equal(got[0].frames[51], samples[49])
    assert got[0].longest_gap_s == pytest.approx(2 / 60)
    assert all(d.is_whole for d in got)


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


def test_a_long_gap_gives_its_invalid_dwells():
    got = dwells(copy_ring(147, 60), lossy(noise(1000), set(range(200, 800))))
    assert [round(d.t_s, 2) for d in got] == [2.45 + k for k in range(14)] + [15.78]
    assert got[5].n_lost == 147
    assert got[-1].is_whole


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


def test_restart_begins_a_new_dwell_and_says_so():
    def frames():
        yield from frames_of(noise(200))
        for frame in frames_of(noise(200, seed=1)):
            yield replace(frame, index=frame.index + 200, restarted=frame.index == 0)

    got = dwells(copy_ring(147, 60), frames())
    kinds = [type(item) for item in got]
    assert kinds == [Dwell, Notice, Dwell]
    assert got[1].kind == "restart"
    assert got[2].t_s == pytest.approx(347 / 60)
    assert np.array_equal(got[2].frames, noise(200, seed=1)[:147])


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
    shape = DwellShape(n_slow=n_slow, hop_s=1.0, frame_rate_hz=rate)
    ring = FrameRing(converter.axis, converter.convert, shape)
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


def test_a_frame_of_another_length_is_refused():
    converter = DownConverter(RF, 8)
    ring = FrameRing(
        converter.axis,
        converter.convert,
        DwellShape(n_slow=3, hop_s=1.0, frame_rate_hz=3.0),
    )
    first, second, third = frames_of(noise(3, RF.n_range).real.astype(np.float32), RF)
    ring.push(first)
    ring.push(second)
    with pytest.raises(FeatureError, match="a frame of 5 bins in a stream of 768"):
        ring.push(replace(third, samples=third.samples[:5]))


def test_who_looks_on_sees_rows_that_are_whole_and_soon_the_newest():
    samples = noise(400, 6)
    ring = copy_ring(147, 60)
    ring._rows = np.zeros((2 * ring._capacity, 6), np.complex64)
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
    samples = noise(200, 6)
    ring = copy_ring(147, 60)
    ring._rows = np.zeros((2 * ring._capacity, 6), np.complex64)
    ring.recent()
    for frame in frames_of(samples):
        ring.push(replace(frame, restarted=frame.index == 100))
    recent = ring.recent(20)
    assert recent.begun_at == 100
    assert np.array_equal(recent.frames, samples[100 : recent.end_frame])
