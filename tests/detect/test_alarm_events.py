"""Alarm events: zones, thresholds, peaks, faults and tamper beside them, and what is kept."""

import dataclasses
import sqlite3
from contextlib import closing

import pytest

from radard.alarm.events import EventTracker, trial_alarm
from radard.alarm.panel import AlarmPanel, AlarmPolicy
from radard.alarm.sensor_state import KeptState, SensorState, StateStore
from radard.alarm.zones import heeds, sight_of, zone_fault
from radard.config.sections import ZonesSection
from radard.detect.tamper import Finding
from radard.log import EventLog
from radard.stream.ring import Notice
from tests.alarm_helpers import decision, track
from tests.radar_helpers import dwell_of, noise
from tests.waiting import wait_for

DWELL = dwell_of(noise(10))
POLICY = AlarmPolicy()


@pytest.mark.parametrize(
    ("include", "exclude", "range_m", "counts"),
    [
        ((), (), 3.0, True),
        (((0.5, 2.0),), (), 1.9, True),
        (((0.5, 2.0),), (), 2.1, False),
        (((0.5, 2.0), (4.0, 5.0)), (), 4.5, True),
        ((), ((2.1, 2.6),), 2.3, False),
        ((), ((2.1, 2.6),), 2.7, True),
        (((0.5, 5.0),), ((2.1, 2.6),), 2.3, False),
        (((0.5, 2.0),), (), 2.0, True),
    ],
)
def test_zones(include, exclude, range_m, counts):
    zones = ZonesSection(include=include, exclude=exclude)
    assert heeds(zones, range_m) is counts
    sight = sight_of(decision(1, 0.9, range_m=range_m), POLICY, zones, 0.8)
    assert (sight.is_hit, sight.is_seen) == (counts, counts)


def tracked(*tracks, human=0.9, range_m=2.3):
    return dataclasses.replace(decision(1, human, range_m=range_m), tracks=tracks)


@pytest.mark.parametrize(
    ("tracks", "counts", "where"),
    [
        ((track(2.3),), False, ""),
        ((track(2.3), track(4.0)), True, "at 4.0 m"),
        ((track(2.3), track(4.0, p_pet=0.9)), False, ""),
        ((track(2.3), track(4.0, None)), True, "at 4.0 m"),
        ((track(3.5), track(1.2)), True, "at 1.2 m"),
        ((), False, ""),
    ],
)
def test_any_track_outside_the_excluded_zone_counts(tracks, counts, where):
    zones = ZonesSection(exclude=((2.1, 2.6),))
    sight = sight_of(tracked(*tracks), POLICY, zones, 0.8)
    assert sight.is_hit is counts
    assert where in sight.reason


@pytest.mark.parametrize(
    ("human", "alarm", "p_on", "hit", "seen"),
    [
        (0.9, True, 0.5, True, True),
        (0.4, True, 0.5, False, True),
        (0.4, True, 0.0, True, True),
        (0.15, False, 0.0, False, True),
        (0.05, False, 0.0, False, False),
        # A verdict against the probabilities has grounds of its own: it counts in full.
        (0.1, True, 0.5, True, True),
        (None, False, 0.0, False, False),
    ],
)
def test_on_and_off_thresholds(human, alarm, p_on, hit, seen):
    policy = AlarmPolicy(p_on=p_on, p_off=0.1)
    sight = sight_of(decision(1, human, alarm=alarm), policy, ZonesSection(), 0.8)
    assert (sight.is_hit, sight.is_seen) == (hit, seen)


def test_undecided_motion_and_what_has_no_range_are_somebody():
    pending = decision(1, 0.0, alarm=False, label="pending")
    assert sight_of(pending, AlarmPolicy(), ZonesSection(), 0.8).is_seen
    plain = dataclasses.replace(decision(1, 0.9), reading=None)
    assert sight_of(plain, POLICY, ZonesSection(include=((0.5, 1.0),)), 0.8).is_hit


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        (decision(1, 0.3, undecided_s=3.0, range_m=1.2), "undecided for 3 s at 1.2 m"),
        (decision(1, 0.3, undecided_s=0.0, range_m=1.2), "undecided at 1.2 m"),
        (decision(1, alarm=True, undecided_s=2.0, range_m=1.2), "undecided for 2 s at 1.2 m"),
        (decision(1, 0.9, range_m=1.2), "human at 1.2 m"),
    ],
)
def test_the_reason_says_what_was_seen(made, reason):
    assert sight_of(made, AlarmPolicy(), ZonesSection(), 0.8).reason == reason


def test_peak_follows_what_is_seen():
    tracker = EventTracker(AlarmPanel(AlarmPolicy(latch_s=10)))
    (new,) = tracker.on_decision(decision(1, 0.5), DWELL)
    tracker.on_decision(decision(2, 0.9), DWELL)
    for t_s in range(3, 7):
        tracker.on_decision(decision(t_s), DWELL)
    events = tracker.on_command("ack", 7.2)
    assert [(e.phase, e.peak, e.id, e.t_s) for e in events] == [("end", 0.9, new.id, 7.2)]
    # The peak of a delay that was broken off is forgotten.
    tracker = EventTracker(AlarmPanel(AlarmPolicy(entry_delay_s=3.0)))
    tracker.on_decision(decision(1, 0.9), DWELL)
    tracker.on_command("disarm", 1)
    tracker.on_command("arm", 2)
    assert tracker.on_decision(decision(3, 0.3), DWELL) == []
    assert tracker.kept(3).alarm_peak == 0.3


@pytest.mark.parametrize("how", ["over", "lost", "restarted"])
def test_an_alarm_behind_an_entry_delay_knows_who_was_seen_in_it(how):
    policy = AlarmPolicy(entry_delay_s=3.0)
    tracker = EventTracker(AlarmPanel(policy))
    for made in (decision(1, 0.6), decision(2, 0.9), decision(3)):
        assert tracker.on_decision(made, DWELL) == []
    if how == "over":
        (new,) = tracker.on_decision(decision(4), DWELL)
    elif how == "lost":
        new = tracker.on_notice(Notice("lost", "unplugged", 3))[-1]
    else:
        (new,) = EventTracker(AlarmPanel(policy)).resume(tracker.kept(3))
    assert (new.kind, new.phase, new.peak) == ("alarm", "new", 0.9)


def test_alarm_fault_and_tamper_are_apart():
    tracker = EventTracker(AlarmPanel(AlarmPolicy(latch_s=100)))
    tracker.on_decision(decision(1, 0.9), DWELL)
    covered = Finding("covered", "still echoes fell 12 dB")
    (tamper,) = tracker.on_decision(decision(2, 0.9, findings=[covered]), DWELL)
    assert (tamper.kind, tamper.reason) == ("tamper", "covered: still echoes fell 12 dB")
    (fault,) = tracker.on_decision(decision(3, fault="9 frames missing"), DWELL)
    assert fault.kind == "fault"
    assert set(tracker.open_events) == {"alarm", "tamper", "fault"}


def test_a_sensor_that_is_given_up_ends_what_is_on():
    tracker = EventTracker()
    tracker.on_decision(decision(1, 0.9), DWELL)
    tracker.on_notice(Notice("restart", "again", 1.5))
    ends = tracker.end_all("taken out", 2.0)
    assert [(e.kind, e.phase, e.reason) for e in ends] == [
        ("alarm", "end", "taken out"),
        ("fault", "end", "taken out"),
    ]
    assert tracker.panel.state == "armed"
    assert not tracker.open_events


def test_disarmed_a_lost_device_is_a_fault_until_the_next_whole_dwell():
    tracker = EventTracker(AlarmPanel(is_armed=False))
    assert tracker.on_decision(decision(1, 0.9), DWELL) == []
    found = Notice("found", "module sends frames again", 3.0)
    assert tracker.on_notice(found) == []
    (fault,) = tracker.on_notice(Notice("lost", "the port is gone", 4.0))
    assert (fault.kind, fault.phase, fault.reason) == ("fault", "new", "the port is gone")
    assert tracker.on_notice(found) == []
    assert tracker.open_events == {"fault": fault}
    assert [e.phase for e in tracker.on_decision(decision(7.0), DWELL)] == ["end"]


def test_what_is_kept_comes_back():
    tracker = EventTracker(AlarmPanel(AlarmPolicy(latch_s=20)))
    assert tracker.kept(1.0) == KeptState(is_armed=True)
    (new,) = tracker.on_decision(decision(5, 0.7), DWELL)
    kept = tracker.kept(1.0)
    again = EventTracker(AlarmPanel(AlarmPolicy(latch_s=20), is_armed=kept.is_armed))
    (event,) = again.resume(kept)
    assert (event.id, event.phase, event.peak) == (new.id, "update", 0.7)
    assert "before a restart" in event.reason
    assert again.resume(again.kept(1.0))[0].reason == event.reason
    ended = [e for t_s in range(1, 30) for e in again.on_decision(decision(t_s), DWELL)]
    assert [(e.phase, e.id) for e in ended] == [("end", new.id)]
    assert EventTracker().resume(KeptState(is_armed=False, alarm_id=new.id)) == []
    # An alarm that goes on begins again in stream time.
    kept = KeptState(is_armed=True, alarm_id="A", alarm_reason="human", alarm_peak=0.7)
    (event,) = EventTracker().resume(kept)
    assert (event.id, event.phase, event.t_s, event.start_t_s) == ("A", "update", 0.0, 0.0)
    assert (event.peak, event.end_t_s, event.is_trial) == (0.7, None, False)
    (begun,) = EventTracker().resume(KeptState(is_armed=True, entry_reason="human"))
    assert (begun.phase, begun.t_s, begun.start_t_s, begun.peak) == ("new", 0.0, 0.0, 0.0)
    assert trial_alarm(3.0)[0].peak == 0.0


def test_an_entry_delay_is_kept_and_its_alarm_begins_at_once():
    policy = AlarmPolicy(entry_delay_s=30, latch_s=20)
    tracker = EventTracker(AlarmPanel(policy))
    assert tracker.on_decision(decision(1, 0.9, range_m=2.5), DWELL) == []
    kept = tracker.kept(1.0)
    assert "2.5 m" in kept.entry_reason
    again = EventTracker(AlarmPanel(policy, is_armed=kept.is_armed), run="b")
    (event,) = again.resume(kept)
    assert (event.kind, event.phase, event.t_s) == ("alarm", "new", 0.0)
    assert event.reason.startswith(kept.entry_reason)
    assert "restarted during the entry delay" in event.reason
    assert again.kept(1.0).alarm_id == event.id
    assert again.kept(1.0).entry_reason is None
    ended = [e for t_s in range(1, 30) for e in again.on_decision(decision(t_s), DWELL)]
    assert [(e.phase, e.id) for e in ended] == [("end", event.id)]
    assert tracker.on_command("disarm", 2) == []
    assert tracker.kept(1.0) == KeptState(is_armed=False)


def test_an_exit_delay_goes_on_after_a_restart_by_the_clock_on_the_wall(monkeypatch):
    policy, now = AlarmPolicy(exit_delay_s=60), [1000.0]
    log = EventLog(None)
    monkeypatch.setattr("x2radar.wall_clock.now_s", lambda: now[0])
    store = StateStore(log, "radar")
    tracker = EventTracker(AlarmPanel(policy, is_armed=False))
    tracker.on_command("arm-home", 5.0)
    store.save(tracker.kept(15.0))
    for clock_s, left_s in ((1020.0, 30.0), (1049.0, 1.0), (1051.0, 0.0), (900.0, 50.0)):
        now[0] = clock_s
        # In this process, and after a restart.
        again = StateStore(log, "radar")
        kept = again.load(is_armed=False)
        assert store.load(is_armed=False) == kept
        assert (kept.is_armed, kept.mode, kept.exit_left_s) == (True, "home", left_s)
        panel = AlarmPanel(policy, is_armed=kept.is_armed, mode=kept.mode)
        assert EventTracker(panel).resume(kept) == []
        assert (panel.state, panel.left_s(0.0)) == (
            ("exit", left_s) if left_s else ("armed", None)
        )
        assert panel.mode == "home"


def test_a_clip_is_named_in_the_phases_that_follow_and_after_a_restart():
    tracker = EventTracker(AlarmPanel(AlarmPolicy(latch_s=10)))
    (new,) = tracker.on_decision(decision(1, 0.7), DWELL)
    # That of an event which is over names nothing.
    tracker.has_clip(f"{new.id}x", "a.h5")
    assert tracker.open_events["alarm"].clip is None
    tracker.has_clip(new.id, "a.h5")
    assert EventTracker(AlarmPanel()).resume(tracker.kept(1.0))[0].clip == "a.h5"
    assert tracker.on_command("disarm", 2)[0].clip == "a.h5"


def test_a_state_outlives_the_daemon_or_counts_as_none(tmp_path, caplog):
    log = EventLog(tmp_path / "log.db")
    state = KeptState(is_armed=False, alarm_id="X", alarm_reason="r", alarm_peak=0.5)
    state = state.model_copy(update={"alarm_clip": "a\udcff.h5", "entry_reason": "human"})
    StateStore(log, "radar").save(state)
    log.close()
    log = EventLog(tmp_path / "log.db")
    assert StateStore(log, "radar").load(is_armed=True) == state
    assert StateStore(log, "other").load(is_armed=True) == KeptState(is_armed=True)
    assert StateStore(log, None).load(is_armed=False) == KeptState(is_armed=False)
    peaks = ('"x"', "{}", "1" + "0" * 400, "[" * 3000 + "]" * 3000)
    made = [f'{{"is_armed": true, "alarm_peak": {peak}}}' for peak in peaks]
    for broken in ("", "{", "[]", "7", "[" * 100_000, '{"armed": 1}', *made):
        log.keep("panel radar", broken)
        assert StateStore(log, "radar").load(is_armed=True) == KeptState(is_armed=True)
    assert caplog.text.count("unreadable and not used") == 10
    log.close()


def test_without_a_named_folder_only_the_command_is_kept():
    log = EventLog(None)
    store = StateStore(log, "radar", keeps_alarms=False)
    store.load(is_armed=True)
    store.save(KeptState(is_armed=True, alarm_id="X"))
    assert log.kept("panel radar") is None
    store.save(KeptState(is_armed=False))
    assert StateStore(log, "radar").load(is_armed=True) == KeptState(is_armed=False)
    # An exit delay is then over at a restart.
    store.save(KeptState(is_armed=True, mode="home", exit_left_s=60.0))
    armed = KeptState(is_armed=True, mode="home")
    assert StateStore(log, "radar", keeps_alarms=False).load(is_armed=False) == armed
    # To this process an alarm is still on when its radar begins again.
    alarm = KeptState(is_armed=True, alarm_id="X")
    for kept in (store, StateStore(log, None)):
        kept.save(alarm)
        assert kept.load(is_armed=False) == alarm


def test_a_remark_is_an_update_and_the_reason_comes_back():
    tracker = EventTracker()
    covered = Finding("covered", "still echoes fell 12 dB")
    (new,) = tracker.on_decision(decision(2, findings=[covered]), DWELL)
    (said,) = tracker.remark("tamper", "armed all the same", 2.5)
    assert (said.id, said.phase, said.reason) == (
        new.id,
        "update",
        f"{new.reason}; armed all the same",
    )
    (back,) = tracker.on_decision(decision(3, findings=[covered]), DWELL)
    assert (back.phase, back.reason) == ("update", new.reason)
    assert tracker.remark("fault", "x", 3.5) == []


def test_the_time_of_an_id_is_stream_time_in_milliseconds():
    digits = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
    for t_s in (0.0, 2.45, 3601.5):
        new, end = trial_alarm(t_s)
        made_ms = 0
        for letter in new.id[:10]:
            made_ms = 32 * made_ms + digits.index(letter)
        assert made_ms == round(1000 * t_s)
        assert len(new.id) == 26
        assert (new.phase, end.phase, new.kind) == ("new", "end", "alarm")
        assert (new.t_s, end.end_t_s) == (t_s, t_s)
        assert new.id == end.id
        assert new.is_trial
        assert end.is_trial

    # Ids come from the last frame and the time and never grow.
    def id_of(rows, t_s=1.0, run=" a"):
        dwell = dataclasses.replace(DWELL, frames=rows)
        return EventTracker(run=run).on_decision(decision(t_s, 0.9), dwell)[0].id

    rows = noise(10)
    other_first, other_last = rows.copy(), rows.copy()
    other_first[:-1] += 1
    other_last[-1] += 1
    assert id_of(rows) == id_of(other_first) != id_of(other_last)
    assert id_of(rows) != id_of(rows, run=" b")
    # 48 bits of milliseconds: after that they begin again.
    assert trial_alarm(((1 << 48) + 5) / 1000)[0].id[:10] == trial_alarm(0.005)[0].id[:10]
    assert trial_alarm(0.005)[0].id[:10] == "0000000005"
    assert len(trial_alarm(1e18)[0].id) == 26


def test_zones_that_leave_nothing_at_home_are_a_fault_and_say_so():
    home = ZonesSection(exclude=((0.0, 1.0),), away=((1.0, 9.0),))
    fault = zone_fault(home, 0.5, 9.0)
    assert fault.endswith("0.50 to 9.00 m, while armed at home")
    assert zone_fault(ZonesSection(away=((1.0, 9.0),)), 0.5, 9.0) == ""
    assert not zone_fault(ZonesSection(exclude=((0.0, 9.0),)), 0.5, 9.0).endswith("home")


def test_what_is_held_is_what_was_written(tmp_path):
    log = EventLog(tmp_path / "log.db")
    store = StateStore(log, "radar")
    store.load(is_armed=True)
    assert store.why_lost(SensorState()) == ""
    store.save(KeptState(is_armed=False, mode="home"))
    now = SensorState(armed=False, mode="home")
    assert store.why_lost() == store.why_lost(now) == ""
    for other in ({"mode": "away"}, {"armed": True}, {"alarm_id": "X"}):
        assert store.why_lost(dataclasses.replace(now, **other)) is None
    with closing(sqlite3.connect(tmp_path / "log.db")) as db:
        db.execute("BEGIN EXCLUSIVE")
        store.save(KeptState(is_armed=True))
        assert store.why_lost(SensorState()) != ""
    wait_for(lambda: store.why_lost(SensorState()) == "")
    log.close()
    # Where nothing can be kept nobody is kept waiting.
    assert StateStore(EventLog(None), None).why_lost(SensorState()) == ""


def test_fault_and_tamper_are_told_once_and_only_tamper_when_its_reason_changes():
    tracker = EventTracker()
    covered = [Finding("covered", "it is dark")]
    made = tracker.on_decision(decision(1.0, findings=covered), DWELL, fault="dead sensor")
    assert [(e.kind, e.phase, e.peak, e.end_t_s) for e in made] == [
        ("fault", "new", 0.0, None),
        ("tamper", "new", 0.0, None),
    ]
    assert not any(e.is_trial for e in made)
    assert tracker.on_decision(decision(2.0, findings=covered), DWELL, fault="dead sensor") == []
    # What else is wrong with a dead sensor is no news.
    assert tracker.on_decision(decision(3.0, findings=covered), DWELL, fault="slow") == []
    moved = [Finding("moved", "it hangs elsewhere")]
    (update,) = tracker.on_decision(decision(4.0, findings=moved), DWELL, fault="slow")
    assert (update.phase, update.t_s) == ("update", 4.0)
    assert (update.start_t_s, update.end_t_s) == (1.0, None)
    ended = tracker.on_decision(decision(5.0), DWELL)
    assert [(e.phase, e.t_s, e.end_t_s) for e in ended] == [("end", 5.0, 5.0)] * 2
    assert {e.id for e in (*made, update)} == {e.id for e in ended}
    assert len({e.id for e in ended}) == 2
    assert tracker.open_events == {}
