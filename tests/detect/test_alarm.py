"""The alarm panel: confirmation, entry delay, latching, refractory time, commands."""

import numpy as np
import pytest

from radard.alarm.panel import AlarmPanel, AlarmPolicy, Sight

HIT = Sight(True, True, "human at 2.0 m")
SEEN = Sight(False, True, "human at 2.0 m")
NOTHING = Sight(False, False, "none")


def play(panel, sights, *, start_s=1.0, quiet=()):
    """Feed one sight a second; return (time, kind, reason) of every step."""
    steps = []
    for k, sight in enumerate(sights):
        t_s = start_s + k
        made = panel.on_sight(t_s, sight, is_quiet=t_s in quiet)
        steps += [(t_s, step.kind, step.reason) for step in made]
    return steps


def kinds(steps):
    return [(t_s, kind) for t_s, kind, _ in steps]


@pytest.mark.parametrize(
    ("k", "n", "hits", "begins_s"),
    [
        (1, 1, "1", 1),
        (2, 3, "1", None),
        (2, 3, "11", 2),
        (2, 3, "101", 3),
        (2, 3, "1001", None),
        (2, 3, "10011", 5),
        (3, 5, "10101", 5),
        (3, 5, "1100011", None),
        (3, 5, "11000111", 8),
        (2, 2, "1010101", None),
        (16, 16, "1" * 16, 16),
        (16, 16, "1" * 15 + "0" + "1" * 15, None),
    ],
)
def test_k_of_n_confirm(k, n, hits, begins_s):
    panel = AlarmPanel(AlarmPolicy(k=k, n=n, latch_s=1e9))
    steps = play(panel, [HIT if h == "1" else NOTHING for h in hits])
    new = [t_s for t_s, kind in kinds(steps) if kind == "new"]
    assert new == ([] if begins_s is None else [begins_s])


def test_an_invalid_window_is_neither_a_hit_nor_a_miss():
    panel = AlarmPanel(AlarmPolicy(k=2, n=2))
    assert kinds(play(panel, [HIT, None, None, HIT])) == [(4, "new")]


def test_latched_until_nobody_was_seen_for_long_enough():
    panel = AlarmPanel(AlarmPolicy(latch_s=5))
    steps = play(panel, [HIT, NOTHING, NOTHING, SEEN, *[NOTHING] * 10])
    assert kinds(steps) == [(1, "new"), (7, "update"), (9, "end")]
    assert steps[-1][2] == "nobody seen for 5 s"
    assert panel.state == "armed"


def test_an_update_says_who_left_and_who_came_back():
    panel = AlarmPanel(AlarmPolicy(latch_s=60))
    steps = play(panel, [HIT, *[NOTHING] * 4, SEEN])
    assert steps[1:] == [(4, "update", "nobody in sight"), (6, "update", "human at 2.0 m, again")]


def test_what_cannot_be_judged_ends_no_alarm():
    panel = AlarmPanel(AlarmPolicy(latch_s=3))
    assert kinds(play(panel, [HIT, NOTHING, *[None] * 30])) == [(1, "new")]
    assert kinds(play(panel, [NOTHING] * 5, start_s=33)) == [(35, "end")]


def test_acknowledged_it_ends_and_is_quiet_for_the_refractory_time():
    panel = AlarmPanel(AlarmPolicy(latch_s=100, refractory_s=10))
    play(panel, [HIT] * 3)
    (end,) = panel.acknowledge(3.5)
    assert (end.kind, end.reason) == ("end", "acknowledged")
    assert panel.acknowledge(3.6) == []
    assert kinds(play(panel, [HIT] * 20, start_s=4)) == [(14, "new")]


def test_entry_delay_gives_time_to_disarm():
    policy = AlarmPolicy(entry_delay_s=10, latch_s=100)
    panel = AlarmPanel(policy)
    assert kinds(play(panel, [HIT, *[NOTHING] * 20])) == [(11, "new")]
    panel = AlarmPanel(policy)
    assert play(panel, [HIT, *[NOTHING] * 5]) == []
    assert panel.state == "entry"
    assert panel.disarm() == []
    assert play(panel, [HIT] * 30, start_s=7) == []


def test_the_exit_delay_gives_time_to_leave():
    policy = AlarmPolicy(exit_delay_s=10, latch_s=100)
    panel = AlarmPanel(policy, is_armed=False)
    panel.arm(0.5)
    assert (panel.state, panel.is_armed, panel.left_s(4.5)) == ("exit", True, 6.0)
    # Who is still there when it ends is seen by the window after it, and no earlier.
    assert kinds(play(panel, [HIT] * 12)) == [(12, "new")]
    assert panel.left_s(12) is None


def test_to_disarm_in_the_exit_delay_leaves_nothing_behind():
    panel = AlarmPanel(AlarmPolicy(exit_delay_s=10), is_armed=False)
    panel.arm(0)
    play(panel, [HIT] * 3)
    assert panel.disarm() == []
    assert play(panel, [HIT] * 20) == []
    assert AlarmPanel(AlarmPolicy(exit_delay_s=10)).state == "armed"


def test_no_way_around_the_alarm_through_the_exit_delay():
    panel = AlarmPanel(AlarmPolicy(exit_delay_s=10, entry_delay_s=5, latch_s=100))
    play(panel, [HIT])
    for mode in ("home", "away"):
        panel.arm(2, mode)
    assert panel.state == "entry"
    assert kinds(play(panel, [NOTHING] * 6, start_s=2)) == [(6, "new")]
    panel.arm(7, "home")
    assert panel.state == "alarm"


def test_to_arm_in_another_way_is_to_arm_again():
    panel = AlarmPanel(AlarmPolicy(exit_delay_s=10), is_armed=False)
    panel.arm(0, "home")
    panel.arm(4, "away")
    assert (panel.state, panel.mode, panel.left_s(4)) == ("exit", "away", 6.0)
    play(panel, [NOTHING], start_s=10)
    panel.arm(11, "away")
    assert panel.state == "armed"
    panel.arm(12, "home")
    assert (panel.state, panel.mode) == ("exit", "home")


def test_what_ends_the_exit_delay_early_leaves_the_sensor_armed():
    panel = AlarmPanel(AlarmPolicy(exit_delay_s=600), is_armed=False)
    panel.arm(0)
    assert panel.on_loss(2) == []
    assert panel.state == "armed"
    panel.disarm()
    panel.arm(3)
    panel.policy = AlarmPolicy(exit_delay_s=2)
    play(panel, [NOTHING], start_s=5)
    assert panel.state == "armed"


def test_no_way_around_the_entry_delay():
    policy = AlarmPolicy(entry_delay_s=10, latch_s=100)
    blinded = AlarmPanel(policy)
    assert kinds(play(blinded, [HIT, *[None] * 20])) == [(11, "new")]
    cut_off = AlarmPanel(policy)
    play(cut_off, [HIT])
    (step,) = cut_off.on_loss(2.5)
    assert step.kind == "new"
    assert "lost" in step.reason
    assert AlarmPanel(policy).on_loss(2.5) == []


def test_disarmed_nothing_begins_and_what_is_on_ends():
    panel = AlarmPanel(AlarmPolicy(latch_s=100), is_armed=False)
    assert play(panel, [HIT] * 5) == []
    panel.arm()
    assert kinds(play(panel, [HIT], start_s=6)) == [(6, "new")]
    assert [s.reason for s in panel.disarm()] == ["disarmed"]
    assert not panel.is_armed


def test_hits_before_arming_do_not_count():
    panel = AlarmPanel(AlarmPolicy(k=2, n=3))
    play(panel, [HIT])
    panel.disarm()
    panel.arm()
    assert play(panel, [HIT, NOTHING, NOTHING]) == []


def test_a_quiet_period_confirms_nothing_but_ends_nothing():
    panel = AlarmPanel(AlarmPolicy(latch_s=100))
    assert play(panel, [HIT] * 3, quiet={1, 2, 3}) == []
    assert kinds(play(panel, [HIT] * 3, start_s=4, quiet={5, 6})) == [(4, "new")]
    assert panel.state == "alarm"


def test_a_resumed_alarm_waits_for_its_acknowledgement():
    panel = AlarmPanel(AlarmPolicy(latch_s=30))
    panel.resume("human at 1 m")
    assert panel.state == "alarm"
    assert kinds(play(panel, [NOTHING] * 40)) == [(30, "end")]


@pytest.mark.parametrize("seed", range(5))
def test_any_history_keeps_the_rules(seed):
    rng = np.random.default_rng(seed)
    policy = AlarmPolicy(k=2, n=3, exit_delay_s=2, entry_delay_s=2, latch_s=4, refractory_s=3)
    panel = AlarmPanel(policy)
    is_on, ended_s, armed_s = False, -1e9, -1e9
    for t_s in range(2000):
        draw = rng.random()
        if draw < 0.02:
            steps = panel.acknowledge(t_s)
        elif draw < 0.03:
            steps = panel.disarm()
        elif draw < 0.05:
            mode = ["away", "home"][rng.integers(2)]
            is_anew = panel.state != "entry" and (not panel.is_armed or panel.mode != mode)
            ended_s = -1e9 if is_anew else ended_s
            steps = panel.arm(t_s, mode)
            armed_s = t_s if is_anew and not is_on else armed_s
        else:
            sight = [HIT, SEEN, NOTHING, NOTHING, NOTHING, None][rng.integers(6)]
            steps = panel.on_sight(t_s, sight)
        for step in steps:
            assert is_on == (step.kind != "new")
            if step.kind == "new":
                assert t_s - ended_s >= policy.refractory_s
                # Armed again meanwhile, within an exit delay, only the first of them counts.
                assert t_s - armed_s >= policy.entry_delay_s
                is_on = True
            elif step.kind == "end":
                is_on, ended_s = False, t_s
        assert is_on == (panel.state == "alarm")


def test_without_a_policy_the_verdict_alone_counts():
    policy = AlarmPolicy()
    assert (policy.k, policy.n, policy.p_on, policy.p_off) == (1, 1, 0.0, 1.0)
    delays_s = policy.exit_delay_s, policy.entry_delay_s, policy.latch_s, policy.refractory_s
    assert delays_s == (0.0, 0.0, 0.0, 0.0)


def test_who_is_seen_in_an_alarm_and_what_is_left_of_a_delay():
    panel = AlarmPanel(AlarmPolicy(entry_delay_s=10, exit_delay_s=30, latch_s=60))
    assert panel.is_seen is False
    assert panel.left_s(0.0) is None
    panel.on_sight(1.0, Sight(True, True, "human"))
    assert panel.entry_reason == "human"
    assert (panel.left_s(3.0), panel.left_s(11.0), panel.left_s(11.5)) == (8.0, 0.0, 0.0)
    panel.on_loss(4.0)
    # Nobody knows; so somebody is.
    assert (panel.is_seen, panel.entry_reason, panel.left_s(5.0)) == (True, None, None)
    panel.on_sight(20.0, Sight(False, False))
    assert panel.is_seen is False
    panel.disarm()
    panel.arm(40.0)
    assert (panel.left_s(50.0), panel.left_s(71.0)) == (20.0, 0.0)


def seen(is_hit):
    return Sight(is_hit, is_hit, "human")


def test_what_was_confirmed_before_an_alarm_ended_confirms_no_other():
    panel = AlarmPanel(AlarmPolicy(k=2, n=4, latch_s=60))
    panel.on_sight(1.0, seen(True))
    assert [c.kind for c in panel.on_sight(2.0, seen(True))] == ["new"]
    panel.acknowledge(3.0)
    assert panel.on_sight(4.0, seen(False)) == []
    assert panel.on_sight(5.0, seen(True)) == []
    assert [c.kind for c in panel.on_sight(6.0, seen(True))] == ["new"]


def test_a_pause_after_an_alarm_is_over_at_its_very_end():
    panel = AlarmPanel(AlarmPolicy(refractory_s=10, latch_s=60))
    panel.on_sight(1.0, seen(True))
    panel.acknowledge(20.0)
    assert panel.on_sight(29.0, seen(True)) == []
    assert [c.kind for c in panel.on_sight(30.0, seen(True))] == ["new"]


def test_short_exit_delays_and_those_of_another_policy():
    panel = AlarmPanel(AlarmPolicy(exit_delay_s=0.5), is_armed=False)
    panel.arm(1.0)
    assert panel.state == "exit"
    panel = AlarmPanel(AlarmPolicy(exit_delay_s=30))
    # Of a time when it was 70 s: it is no longer than it would be now.
    panel.resume_exit(70.0)
    assert panel.left_s(0.0) == 30.0
    panel.on_sight(30.0, seen(True))
    assert panel.state == "armed"
