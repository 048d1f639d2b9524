"""SinkWatch: what counts as trouble of an output, and for how long."""

import pytest

from radard.outputs.base import SinkState
from radard.outputs.registry import DROPPED_S, GRACE_S, STUCK_S, SinkWatch


class Spy:
    """A sink of which only the state matters."""

    def __init__(self, name="x"):
        self.name = name
        self.state = SinkState()

    def be(self, **changes):
        self.state = SinkState(**changes)


REFUSED = {"status": "retrying", "reason": "refused"}
# What the sink's state is, how much later, and what is said of it.
WAITS = {"n_sent": 5, "n_waiting": 3}
STORIES = {
    "a retry that helps soon is no trouble": [
        *(({}, 0.0, ""), (REFUSED, GRACE_S / 2, ""), ({"n_sent": 1}, 1.0, "")),
        *((REFUSED, 0.0, ""), (REFUSED, GRACE_S - 0.1, ""), (REFUSED, 0.2, "refused")),
        ({"n_sent": 2}, 0.1, ""),
    ],
    "records wait while nothing moves": [
        *((WAITS, 0.0, ""), (WAITS, STUCK_S - 0.1, "")),
        (WAITS, 0.2, "stands still, 3 records wait"),
        *(({"n_sent": 6, "n_waiting": 3}, 0.1, ""), ({"n_sent": 6}, 10 * STUCK_S, "")),
        ({"n_sent": 9, "n_waiting": 1, "busy_s": STUCK_S}, 0.1, "stands still, 1 records wait"),
    ],
    "dropped records are said for a while": [
        *(({}, 0.0, ""), ({"n_dropped": 1}, 1.0, "drops records")),
        ({"n_dropped": 1}, DROPPED_S - 1.0, "drops records"),
        ({"n_dropped": 1}, 1.1, ""),
        ({**REFUSED, "n_dropped": 2}, GRACE_S, "refused, drops records"),
    ],
}


@pytest.mark.parametrize("story", STORIES)
def test_what_is_trouble_and_for_how_long(story):
    now_s, sink = [100.0], Spy()
    watch = SinkWatch(lambda: now_s[0])
    for state, after_s, said in STORIES[story]:
        now_s[0] += after_s
        sink.be(**state)
        assert watch.look([(None, sink)]).get((None, "x"), "") == said


def test_a_sink_that_is_gone_and_comes_back_begins_anew():
    now_s, sink = [0.0], Spy()
    watch = SinkWatch(lambda: now_s[0])
    sink.be(status="retrying", reason="refused")
    for t_s, sinks, found in ((0, [sink], 0), (9, [sink], 1), (10, [], 0), (11, [sink], 0)):
        now_s[0] = t_s
        assert len(watch.look([("hall", each) for each in sinks])) == found
