import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radard.ring import Dwell, DwellShape, Notice
from tests.radar_helpers import copy_ring, frames_of, noise


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
    while (item := ring.take(5)) is not None:
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


def test_rate_that_is_no_whole_number_keeps_one_dwell_a_second():
    got = dwells(copy_ring(41, 17.06), frames_of(noise(17 * 60)))
    times = np.array([d.t_s for d in got])
    assert times[0] == pytest.approx(41 / 17.06)
    assert np.abs(times - times[0] - np.arange(len(times))).max() < 0.5 / 17.06 + 1e-9


@settings(deadline=None, derandomize=True, max_examples=30)
@given(n_slow=st.integers(2, 30), rate=st.integers(1, 20), n=st.integers(0, 120))
def test_every_dwell_is_the_last_frames(n_slow, rate, n):
    samples = noise(n, 4) if n else np.empty((0, 4), np.complex64)
    ring = copy_ring(n_slow, rate)
    ring._rows = np.zeros((2 * ring._capacity, 4), np.complex64)
    got = dwells(ring, frames_of(samples))
    ends = list(range(n_slow, n + 1, rate))
    assert [round(d.t_s * rate) for d in got] == ends
    for dwell, end in zip(got, ends, strict=True):
        assert np.array_equal(dwell.frames, samples[end - n_slow : end])


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


@pytest.mark.parametrize(
    ("lost", "whole"), [({10, 11}, True), ({10, 30, 50}, False), ({10, 11, 12, 13}, False)]
)
def test_what_counts_as_whole(lost, whole):
    got = dwells(copy_ring(147, 60), lossy(noise(147), lost))
    assert got[0].is_whole is whole


def test_a_long_gap_gives_its_invalid_dwells():
    got = dwells(copy_ring(147, 60), lossy(noise(1000), set(range(200, 800))))
    assert [round(d.t_s, 2) for d in got] == [2.45 + k for k in range(15)]
    assert got[5].n_lost == 147
    assert got[-1].is_whole


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


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_frame_that_is_not_finite_counts_as_lost(bad):
    samples = noise(147)
    samples[60, 3] = bad
    ring = copy_ring(147, 60)
    got = dwells(ring, frames_of(samples))
    assert got[0].n_lost == 1
    assert np.isfinite(got[0].frames).all()
    assert ring.n_unusable == 1


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
    while (dwell := ring.take(5)) is not None:
        assert np.array_equal(dwell.frames, samples[60 * k : 60 * k + 147])
        k += 1
    assert k == 18
    thread.join()


def test_stop_frees_a_waiting_writer():
    ring = copy_ring(147, 60)
    done = threading.Event()

    def push():
        while ring.push(next(frames_of(noise(1)))):
            pass
        done.set()

    threading.Thread(target=push).start()
    ring.stop()
    assert done.wait(5)


def test_take_times_out():
    with pytest.raises(TimeoutError):
        copy_ring(147, 60).take(0.01)
