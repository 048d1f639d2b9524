import math

import numpy as np
import pytest

from radard.stream.coalesced_reads import PAUSE_S, CoalescedReads
from radard.stream.frame_timing import FrameTiming
from x2radar.errors import TransportClosed


class Port:
    """A transport whose reads are written down beforehand; None is a port that went away."""

    def __init__(self, *reads, is_usb=False):
        self.reads = list(reads)
        self.written = []
        self.is_usb = is_usb

    def read(self, timeout_s):
        assert timeout_s > 0
        data = self.reads.pop(0)
        if data is None:
            msg = "gone"
            raise TransportClosed(msg)
        return data

    def write(self, data):
        self.written.append(data)

    def close(self):
        self.reads.clear()


class Clock:
    """Time that passes only in sleeps."""

    def __init__(self):
        self.now_s = 100.0
        self.slept_s = []

    def __call__(self):
        return self.now_s

    def sleep(self, duration_s):
        self.slept_s.append(duration_s)
        self.now_s += duration_s


def reader(*reads, due_s=lambda: math.inf):
    clock = Clock()
    port = CoalescedReads(Port(*reads), due_s=due_s, clock=clock, sleep=clock.sleep)
    return port, clock


def test_a_stream_is_left_alone_between_two_reads():
    port, clock = reader(b"x" * 3084, b"x" * 6168, b"x" * 6168)
    assert [len(port.read(1.0)) for _ in range(3)] == [3084, 6168, 6168]
    assert clock.slept_s == pytest.approx([PAUSE_S, PAUSE_S])


def test_a_late_reader_does_not_wait():
    port, clock = reader(b"x" * 3084, b"x" * 3084)
    port.read(1.0)
    clock.now_s += 2 * PAUSE_S
    port.read(1.0)
    assert clock.slept_s == []


def test_replies_to_commands_never_wait():
    port, clock = reader(b"reply", b"", b"another", b"x" * 600, b"x")
    for _ in range(4):
        port.read(1.0)
    assert clock.slept_s == []


def test_what_a_full_terminal_still_holds_is_read_at_once():
    port, clock = reader(b"a" * 4095, b"b" * 4095, b"c" * 100, b"d")
    assert port.read(1.0) == b"a" * 4095 + b"b" * 4095 + b"c" * 100
    assert clock.slept_s == []


def test_bytes_before_the_end_of_a_port_are_kept():
    port, _ = reader(b"a" * 4095, None, None)
    assert port.read(1.0) == b"a" * 4095
    with pytest.raises(TransportClosed):
        port.read(1.0)


def test_a_port_that_is_always_full_is_not_read_for_ever():
    port, _ = reader(*[b"a" * 4095] * 40)
    assert len(port.read(1.0)) == 17 * 4095


@pytest.mark.parametrize("is_usb", [True, False])
def test_everything_else_is_the_ports_own(is_usb):
    inner = Port(b"x", is_usb=is_usb)
    port = CoalescedReads(inner)
    port.write(b"hello")
    assert inner.written == [b"hello"]
    assert port.is_usb is is_usb
    port.close()
    assert inner.reads == []


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
