import math

import numpy as np
import pytest

from radard.stream.coalesced_reads import PAUSE_S, CoalescedReads
from radard.stream.frame_timing import FrameTiming
from tests.device_helpers import Clock
from x2radar.errors import TransportClosed


class Port:
    """A transport whose reads are written down beforehand; None is a port that went away."""

    is_usb = False

    def __init__(self, *reads):
        self.reads = list(reads)

    def read(self, timeout_s):
        assert timeout_s > 0
        data = self.reads.pop(0)
        if data is None:
            msg = "gone"
            raise TransportClosed(msg)
        return data

    def write(self, data):
        raise NotImplementedError

    def close(self):
        raise NotImplementedError


def reader(*reads, due_s=lambda: math.inf):
    clock = Clock()
    port = CoalescedReads(Port(*reads), due_s=due_s, clock=clock, sleep=clock.sleep)
    return port, clock


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
    frame_timing = FrameTiming(rate_hz)
    assert frame_timing.arrival_s(1) == math.inf
    hop = round(rate_hz)
    errors, next_s, read_s = [], 0.0, 0.0
    for n in range(1, 12 * hop):
        sent_s = 50 + n * (1 + drift) / rate_hz + rng.uniform(0, 2e-4)
        if n % hop == 0:
            errors.append(frame_timing.arrival_s(n) - sent_s)
        if sent_s > read_s:
            # Not there at the last read: the next one finds it, and waits for it if need be.
            read_s = max(sent_s, next_s)
            next_s = read_s + PAUSE_S
        frame_timing.note(n, read_s)
        if n % hop == 0:
            frame_timing.next_hop()
    assert max(errors) < 6e-3
    assert min(errors) > -0.01
    frame_timing.reset()
    frame_timing.note(3, 0.0)
    assert frame_timing.arrival_s(5) == math.inf
