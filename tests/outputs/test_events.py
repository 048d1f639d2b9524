import re

import numpy as np
import pytest

from radard.alarm.events import EventTracker
from radard.alarm.panel import AlarmPanel, AlarmPolicy
from radard.detect.gate import GateReading
from radard.judge.classifier import Probabilities
from radard.judge.decision import Decision
from radard.stream.ring import Notice
from tests.radar_helpers import dwell_of, noise

DWELL = dwell_of(noise(10))


def decision(t_s, *, alarm=False, invalid=False, human=0.0):
    p = Probabilities(human, 1 - human, 0.0)
    return Decision(
        seq=1,
        t_s=t_s,
        gate="invalid" if invalid else "open",
        reading=None if invalid else GateReading(True, 0, -30, -20, 1.5),
        window=None if invalid else p,
        fused=None if invalid else p,
        label="invalid" if invalid else ("human" if alarm else "pet"),
        alarm=alarm,
        frames=10,
        dropped=5 if invalid else 0,
        fault="5 frames missing" if invalid else "",
    )


def test_an_alarm_begins_lasts_and_ends_under_one_id():
    tracker = EventTracker()
    new = tracker.on_decision(decision(1, alarm=True, human=0.5), DWELL)
    assert [(e.phase, e.kind, e.start_t_s) for e in new] == [("new", "alarm", 1)]
    assert new[0].reason == "human at 1.5 m"
    assert tracker.on_decision(decision(2, alarm=True, human=0.9), DWELL) == []
    (end,) = tracker.on_decision(decision(3), DWELL)
    assert (end.phase, end.id, end.end_t_s, end.peak) == ("end", new[0].id, 3, 0.9)
    assert tracker.on_decision(decision(4), DWELL) == []


def test_an_invalid_window_is_a_fault_and_ends_no_alarm():
    tracker = EventTracker()
    tracker.on_decision(decision(1, alarm=True), DWELL)
    (fault,) = tracker.on_decision(decision(2, invalid=True), DWELL)
    assert (fault.kind, fault.phase, fault.reason) == ("fault", "new", "5 frames missing")
    ended = tracker.on_decision(decision(3, alarm=True), DWELL)
    assert [(e.kind, e.phase) for e in ended] == [("fault", "end")]


def test_a_lost_device_is_a_fault_until_the_next_whole_dwell():
    tracker = EventTracker()
    (fault,) = tracker.on_notice(Notice("lost", "unplugged", 5))
    assert (fault.kind, fault.phase) == ("fault", "new")
    assert tracker.on_notice(Notice("found", "back", 6)) == []
    assert [e.phase for e in tracker.on_decision(decision(7), DWELL)] == ["end"]


def test_ids_are_ulids_that_follow_from_the_frames():
    def first(dwell, t_s=1.0):
        return EventTracker().on_decision(decision(t_s, alarm=True), dwell)[0].id

    assert re.fullmatch("[0-9A-HJKMNP-TV-Z]{26}", first(DWELL))
    assert first(DWELL) == first(DWELL)
    assert first(DWELL) != first(dwell_of(noise(10, seed=1)))
    assert first(DWELL, 1.0) < first(DWELL, 2.0)
    assert len({first(dwell_of(np.roll(noise(10), k, axis=0))) for k in range(5)}) == 5


@pytest.mark.parametrize("how", ["over", "lost", "restarted"])
def test_an_alarm_behind_an_entry_delay_knows_who_was_seen_in_it(how):
    policy = AlarmPolicy(entry_delay_s=3.0)
    tracker = EventTracker(AlarmPanel(policy))
    assert tracker.on_decision(decision(1, alarm=True, human=0.6), DWELL) == []
    assert tracker.on_decision(decision(2, alarm=True, human=0.9), DWELL) == []
    assert tracker.on_decision(decision(3), DWELL) == []
    if how == "over":
        (new,) = tracker.on_decision(decision(4), DWELL)
    elif how == "lost":
        new = tracker.on_notice(Notice("lost", "unplugged", 3))[-1]
    else:
        (new,) = EventTracker(AlarmPanel(policy)).resume(tracker.kept(3))
    assert (new.kind, new.phase, new.peak) == ("alarm", "new", 0.9)


def test_the_peak_of_a_delay_that_was_broken_off_is_forgotten():
    tracker = EventTracker(AlarmPanel(AlarmPolicy(entry_delay_s=3.0)))
    tracker.on_decision(decision(1, alarm=True, human=0.9), DWELL)
    tracker.on_command("disarm", 1)
    tracker.on_command("arm", 2)
    assert tracker.on_decision(decision(3, alarm=True, human=0.3), DWELL) == []
    assert tracker.kept(3).alarm_peak == 0.3
