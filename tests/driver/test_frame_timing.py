"""How fast frames come: reads that wait, a rate that was not set, and clocks that run apart."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from radard.stream.frame_timing import RateWatch
from radard.stream.source import PAUSE_S, CoalescedReads
from tests.device_helpers import Clock, plugged
from tests.radar_helpers import BASEBAND, copy_ring, events, noise, run_radard, states
from x2radar.errors import TransportClosed
from x2radar.frame import Frame


def reader(*reads, due_s=lambda: math.inf):
    """A port whose reads are written down beforehand; None is one that went away."""
    left, clock = list(reads), Clock()

    def read(timeout_s):
        assert timeout_s > 0
        if (data := left.pop(0)) is None:
            raise TransportClosed("gone")
        return data

    inner = SimpleNamespace(read=read, write=None, close=None)
    return CoalescedReads(inner, due_s=due_s, clock=clock, sleep=clock.sleep), clock


@pytest.mark.parametrize(
    ("sizes", "got", "n_sleeps"),
    [
        # A stream is left alone between two reads; replies to commands never wait.
        ((3084, 6168, 6168), [3084, 6168, 6168], 2),
        ((5, 0, 7, 600, 1), [5, 0, 7, 600], 0),
        # What a full terminal still holds is read at once, though not for ever.
        ((4095, 4095, 100, 1), [8290], 0),
        ([4095] * 40, [17 * 4095], 0),
    ],
)
def test_what_is_read_at_once_and_what_waits(sizes, got, n_sleeps):
    reads = [bytes([65 + k]) * size for k, size in enumerate(sizes)]
    port, clock = reader(*reads)
    found = [port.read(1.0) for _ in got]
    assert [len(data) for data in found] == got
    assert b"".join(reads).startswith(b"".join(found))
    assert clock.slept_s == pytest.approx([PAUSE_S] * n_sleeps)


def test_a_late_reader_does_not_wait_and_bytes_before_the_end_are_kept():
    port, clock = reader(b"x" * 3084, b"x" * 3084)
    port.read(1.0)
    clock.now_s += 2 * PAUSE_S
    port.read(1.0)
    assert clock.slept_s == []
    port, _ = reader(b"a" * 4095, None, None)
    assert port.read(1.0) == b"a" * 4095
    with pytest.raises(TransportClosed):
        port.read(1.0)


def test_the_frame_that_completes_a_dwell_never_waits():
    due_s = [100.030]
    port, clock = reader(*[b"x" * 3084] * 6, due_s=lambda: due_s[0])
    port.read(1.0)
    port.read(1.0)
    assert clock.slept_s == pytest.approx([0.024])
    clock.now_s += 0.001
    port.read(1.0)
    assert len(clock.slept_s) == 1
    due_s[0] += 1
    port.read(1.0)
    assert clock.slept_s[1:] == pytest.approx([PAUSE_S])


@pytest.mark.parametrize("drift", [0.0, 3e-3, -3e-3])
@pytest.mark.parametrize("rate_hz", [20.0, 60.0, 200.0])
def test_arrival_is_forecast_from_frames_that_waited(drift, rate_hz):
    rng = np.random.default_rng(1)
    hop, samples = round(rate_hz), noise(1)[0]
    ring = copy_ring(hop, rate_hz)
    assert ring.due_s() == math.inf
    errors, next_s, read_s = [], 0.0, 0.0
    for n in range(1, 12 * hop):
        sent_s = 50 + n * (1 + drift) / rate_hz + rng.uniform(0, 2e-4)
        if n % hop == 0:
            errors.append(ring.due_s() - sent_s)
        if sent_s > read_s:
            # Not there at the last read: the next one finds it, and waits for it if need be.
            read_s = max(sent_s, next_s)
            next_s = read_s + PAUSE_S
        list(ring.items(Frame(samples, n, n, 0, n == 1, BASEBAND, read_s)))
    assert max(errors) < 6e-3
    assert min(errors) > -0.01
    list(ring.items(Frame(samples, 3, 3, 0, True, BASEBAND, 0.0)))
    assert ring.due_s() == math.inf


def rates_said(pace, n=30, late=lambda _k: 0.0):
    watch = RateWatch(60.0)
    return [watch.note(k, 100 + k / pace + late(k)) for k in range(n)]


@pytest.mark.parametrize("pace", [0.5, 0.85, 1.15, 2.0])
def test_another_rate_is_said_after_ten_seconds_of_the_stream(pace):
    reasons = rates_said(pace)
    assert not any(reasons[:10])
    assert all(f"{60 * pace:.3g} Hz, not at 60 Hz" in reason for reason in reasons[10:])


@pytest.mark.parametrize("pace", [0.95, 1.0, 1.05])
def test_clocks_may_differ_and_hosts_may_pause(pace):
    assert not any(rates_said(pace))
    assert not any(rates_said(1.0, late=lambda k: 30.0 if k >= 15 else 0.0))
    assert not any(rates_said(1.0, late=lambda k: 3.0 if k == 15 else 0.0))


def test_an_interruption_begins_it_again_and_recordings_have_no_clock():
    watch = RateWatch(60.0)
    assert not any(watch.note(k, 100 + 2 * k) for k in range(10))
    watch.reset()
    assert watch.note(10, 120) == ""
    assert not any(watch.note(k, 0.0) for k in range(30))


@pytest.mark.integration
def test_a_module_at_thrice_its_rate_is_degraded_and_a_fault():
    with plugged(speed=3.0) as pty:
        argv = ("--port", pty.path, "-o", "json", "--duration", "16", "--model", "none")
        code, records, _ = run_radard(*argv)
    assert code == 0
    assert "not at 60 Hz" in events(records, "fault")[0]["reason"]
    assert any(s == "degraded" and "not at 60 Hz" in why for s, why in states(records))


def followed(drift, seconds, *, seed=0, stalls=0.01):
    """The estimate after so long; delays of 5 ms on average, and now and then a second."""
    rng = np.random.default_rng(seed)
    clock = RateWatch(60.0)
    for t_s in range(1, seconds):
        late_s = rng.exponential(0.005) + (1.0 if rng.random() < stalls else 0.0)
        clock.note(float(t_s), 1e6 + t_s / (1 + drift) + late_s)
    return clock.drift


@pytest.mark.parametrize("drift", [-200e-6, -3e-6, 0.0, 25e-6, 200e-6])
@pytest.mark.parametrize(("seconds", "within"), [(200, 60e-6), (3600, 1.5e-6)])
def test_a_known_drift_is_found_within_the_interval(drift, seconds, within):
    found = [followed(drift, seconds, seed=seed) for seed in range(10)]
    assert max(each.uncertainty for each in found) < within
    # 95 % are meant; of these ten, all but one.
    assert sum(abs(each.ratio - drift) <= each.uncertainty for each in found) >= 9


def test_without_scatter_the_interval_is_not_nothing_and_without_arrivals_there_is_none():
    clock, silent = RateWatch(60.0), RateWatch(60.0)
    for t_s in range(1, 400):
        clock.note(float(t_s), 50.0 + t_s)
        silent.note(float(t_s), 0.0)
    assert clock.drift.ratio == pytest.approx(0.0, abs=1e-12)
    assert clock.drift.uncertainty > 1e-6
    assert silent.drift is None


def test_nothing_is_told_too_soon_or_over_an_interruption():
    assert followed(1e-4, 100) is None
    watch = RateWatch(60.0)
    for begin, end, ahead_s, is_told in ((1, 300, 100.0, True), (300, 390, 500.0, False)):
        assert watch.drift is None
        for t_s in range(begin, end):
            watch.note(float(t_s), ahead_s + t_s)
        assert (watch.drift is not None) is is_told
        watch.reset()
