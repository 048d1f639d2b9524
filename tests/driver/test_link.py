"""A link's waits, on a clock that only reads move."""

import threading
from collections import Counter
from types import SimpleNamespace

import pytest

from x2radar.device.link import Deadlines, Link
from x2radar.wire import framing
from x2radar.wire import messages as msg
from x2radar.wire.codec import encode
from x2radar.wire.wire_ids import ErrorCode, Mode

BUSY, IDLE = msg.ErrorReply(ErrorCode.BUSY), msg.SetMode(Mode.IDLE)


@pytest.fixture
def linked(monkeypatch):
    """Return a function of answers: a link of which each read takes its whole wait; the waits."""

    def link(*answers):
        waits, left = [], [framing.encode(encode(each)) if each else b"" for each in answers]

        def read(wait_s):
            waits.append(wait_s)
            return left.pop(0) if left else b""

        clock = SimpleNamespace(monotonic=lambda: 64.0 + sum(waits))
        monkeypatch.setattr("x2radar.device.link.time", clock)
        transport = SimpleNamespace(read=read, write=lambda _: None)
        about = {"name": "it", "counts": Counter(), "halt": threading.Event()}
        return Link(transport, lambda *_: None, deadlines=Deadlines(again_s=0.125), **about), waits

    return link


def test_it_listens_and_asks_for_as_long_as_it_is_told(linked):
    link, waits = linked()
    link.listen(0.625)
    assert waits == [0.25, 0.25, 0.125]
    assert link.ask(msg.Ping(), 0.5) is None
    assert waits[3:] == [0.25, 0.25]


def test_a_busy_module_is_asked_again_after_a_pause_until_its_time_is_over(linked):
    link, waits = linked(BUSY, None, msg.Ack())
    assert link.command(IDLE, wait_s=0.25) == msg.Ack()
    assert waits == [0.25, 0.125, 0.25]
    assert link.counts == {"retries": 1}


def test_a_command_that_shows_its_effect_counts_as_acknowledged(linked):
    link, waits = linked()
    assert link.command(IDLE, is_done=lambda: True) == msg.Ack()
    assert sum(waits) == 2.0
