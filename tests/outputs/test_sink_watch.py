"""SinkWatch: what counts as trouble of an output, and for how long."""

import pytest

from radard.outputs.base import SinkState
from radard.run.sink_watch import DROPPED_S, GRACE_S, STUCK_S, SinkWatch


class Spy:
    """A sink of which only the state matters."""

    def __init__(self, name="x"):
        self.name = name
        self.state = SinkState()

    def be(self, **changes):
        self.state = SinkState(**changes)


@pytest.fixture
def looked():
    now_s, sink = [100.0], Spy()
    watch = SinkWatch(lambda: now_s[0])

    def look(after_s=0.0):
        now_s[0] += after_s
        return watch.look([(None, sink)]).get((None, "x"), "")

    look.sink = sink
    return look


def test_a_retry_that_helps_soon_is_no_trouble(looked):
    assert looked() == ""
    looked.sink.be(status="retrying", reason="refused")
    assert looked(GRACE_S / 2) == ""
    looked.sink.be(n_sent=1)
    assert looked(1.0) == ""
    looked.sink.be(status="retrying", reason="refused")
    assert looked(GRACE_S - 0.1) == ""
    assert looked(0.2) == "refused"
    looked.sink.be(n_sent=2)
    assert looked(0.1) == ""


def test_records_that_wait_while_nothing_moves(looked):
    looked.sink.be(n_sent=5, n_waiting=3)
    assert looked() == ""
    assert looked(STUCK_S - 0.1) == ""
    assert looked(0.2) == "stands still, 3 records wait"
    looked.sink.be(n_sent=6, n_waiting=3)
    assert looked(0.1) == ""
    looked.sink.be(n_sent=6)
    assert looked(10 * STUCK_S) == ""
    looked.sink.be(n_sent=9, n_waiting=1, busy_s=STUCK_S)
    assert looked(0.1) == "stands still, 1 records wait"


def test_dropped_records_are_said_for_a_while(looked):
    assert looked() == ""
    looked.sink.be(n_dropped=1)
    assert looked(1.0) == "drops records"
    assert looked(DROPPED_S - 1.0) == "drops records"
    assert looked(1.1) == ""
    looked.sink.be(status="retrying", reason="refused", n_dropped=2)
    assert looked(GRACE_S) == "refused, drops records"


def test_a_sink_that_is_gone_and_comes_back_begins_anew():
    now_s, sink = [0.0], Spy()
    watch = SinkWatch(lambda: now_s[0])
    sink.be(status="retrying", reason="refused")
    for t_s, sinks, found in ((0, [sink], 0), (9, [sink], 1), (10, [], 0), (11, [sink], 0)):
        now_s[0] = t_s
        assert len(watch.look([("hall", each) for each in sinks])) == found
