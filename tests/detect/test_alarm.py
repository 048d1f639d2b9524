"""The alarm panel: confirmation, entry delay, latching, refractory time, commands."""

import pytest

from radard.alarm.panel import AlarmPanel, AlarmPolicy, Sight

HIT = Sight(True, True, "human at 2.0 m")
SEEN = Sight(False, True, "human at 2.0 m")
NOTHING = Sight(False, False, "none")


def play(panel, sights, *, start_s=1.0):
    """Feed one sight a second; return (time, kind, reason) of every step."""
    steps = []
    for k, sight in enumerate(sights):
        t_s = start_s + k
        steps += [(t_s, step.kind, step.reason) for step in panel.on_sight(t_s, sight)]
    return steps


def kinds(steps):
    return [(t_s, kind) for t_s, kind, _ in steps]


SIGHTS = {"h": HIT, "q": HIT, "s": SEEN, ".": NOTHING, "x": None}
"""One a second: a hit, one in a quiet period, somebody seen, nobody, a window that is invalid."""
COMMANDS = {
    "A": lambda panel, t_s: panel.arm(t_s),
    "H": lambda panel, t_s: panel.arm(t_s, "home"),
    "D": lambda panel, _: panel.disarm(),
    "K": lambda panel, t_s: panel.acknowledge(t_s),
    "L": lambda panel, t_s: panel.on_loss(t_s),
}
"""Between two seconds: arm, arm at home, disarm, acknowledge, and the device is lost."""
OF_N = {"latch_s": 1e9}


@pytest.mark.parametrize(
    ("policy", "script", "made"),
    [
        ({"k": 1, "n": 1, **OF_N}, "h", "1 new"),
        ({"k": 2, "n": 3, **OF_N}, "h.h", "3 new"),
        ({"k": 2, "n": 3, **OF_N}, "h..hh", "5 new"),
        ({"k": 3, "n": 5, **OF_N}, "hh...hhh", "8 new"),
        ({"k": 2, "n": 2, **OF_N}, "h.h.h.h", ""),
        ({"k": 16, "n": 16, **OF_N}, "h" * 16, "16 new"),
        ({"k": 16, "n": 16, **OF_N}, "h" * 15 + "." + "h" * 15, ""),
        # An invalid window is neither a hit nor a miss, and ends no alarm.
        ({"k": 2, "n": 2}, "hxxh", "4 new"),
        ({"latch_s": 3}, "h." + "x" * 30 + "." * 5, "1 new, 35 end"),
        # Acknowledged, it ends and is quiet for the refractory time, to its very end.
        ({"latch_s": 100, "refractory_s": 10}, "hhhKK" + "h" * 20, "1 new, 3 end, 13 new"),
        # What was confirmed before an alarm ended confirms no other.
        ({"k": 2, "n": 4, "latch_s": 60}, "hhK.hh", "2 new, 2 end, 5 new"),
        # The entry delay gives time to disarm, and there is no way around it.
        ({"entry_delay_s": 10, "latch_s": 100}, "h" + "." * 20, "11 new"),
        ({"entry_delay_s": 10, "latch_s": 100}, "h.....D" + "h" * 30, ""),
        ({"entry_delay_s": 10, "latch_s": 100}, "h" + "x" * 20, "11 new"),
        ({"entry_delay_s": 10, "latch_s": 100}, "h.L", "2 new"),
        ({"entry_delay_s": 10, "latch_s": 100}, "..L", ""),
        # To disarm in the exit delay leaves nothing behind; on its own it begins by a command.
        ({"exit_delay_s": 10}, "DAhhhD" + "h" * 20, ""),
        ({"exit_delay_s": 10}, "h", "1 new"),
        # To arm in another way is to arm again, and no way around a delay or an alarm.
        ({"exit_delay_s": 10, "entry_delay_s": 5, "latch_s": 99}, "hHA.....HD", "6 new, 6 end"),
        ({"exit_delay_s": 10, "latch_s": 99}, "DH....A......h", "11 new"),
        ({"exit_delay_s": 10}, "Hhhh", ""),
        # Disarmed, nothing begins and what is on ends; hits before arming do not count.
        ({"latch_s": 100}, "DhhhhhAhD", "6 new, 6 end"),
        ({"k": 2, "n": 3}, "hDAh..", ""),
        # A quiet period confirms nothing, and ends nothing.
        ({"latch_s": 100}, "qqq", ""),
        ({"latch_s": 100}, "qqqhqqD", "4 new, 6 end"),
    ],
)
def test_what_becomes_of_an_alarm(policy, script, made):
    panel, t_s, steps = AlarmPanel(AlarmPolicy(**policy)), 0, []
    for each in script:
        if each in COMMANDS:
            found = COMMANDS[each](panel, t_s)
        else:
            t_s += 1
            found = panel.on_sight(t_s, SIGHTS[each], is_quiet=each == "q")
        steps += [f"{t_s} {step.kind}" for step in found]
    assert ", ".join(steps) == made
    assert panel.is_armed == (script.rfind("D") <= script.rfind("A"))


def test_the_reasons_of_what_ends_or_begins_an_alarm():
    panel = AlarmPanel(AlarmPolicy(entry_delay_s=10, latch_s=100))
    play(panel, [HIT])
    assert panel.state == "entry"
    assert "lost" in panel.on_loss(2.5)[0].reason
    assert [s.reason for s in panel.acknowledge(3.5)] == ["acknowledged"]
    play(panel, [HIT] * 11, start_s=4)
    assert [s.reason for s in panel.disarm()] == ["disarmed"]


def test_latched_until_nobody_was_seen_for_long_enough():
    panel = AlarmPanel(AlarmPolicy(latch_s=5))
    steps = play(panel, [HIT, NOTHING, NOTHING, SEEN, *[NOTHING] * 10])
    assert kinds(steps) == [(1, "new"), (7, "update"), (9, "end")]
    assert steps[-1][2] == "nobody seen for 5 s"
    assert panel.state == "armed"
    # An update says who left and who came back.
    panel = AlarmPanel(AlarmPolicy(latch_s=60))
    steps = play(panel, [HIT, *[NOTHING] * 4, SEEN])
    assert steps[1:] == [(4, "update", "nobody in sight"), (6, "update", "human at 2.0 m, again")]


def test_exit_delays_of_another_policy_than_they_began_with():
    panel = AlarmPanel(AlarmPolicy(exit_delay_s=600), is_armed=False)
    panel.arm(3)
    panel.policy = AlarmPolicy(exit_delay_s=2)
    play(panel, [NOTHING], start_s=5)
    assert panel.state == "armed"
    panel = AlarmPanel(AlarmPolicy(exit_delay_s=0.5), is_armed=False)
    panel.arm(1.0)
    assert panel.state == "exit"
    panel = AlarmPanel(AlarmPolicy(exit_delay_s=30))
    # Of a time when it was 70 s: it is no longer than it would be now.
    panel.resume_exit(70.0)
    assert panel.left_s(0.0) == 30.0
    panel.on_sight(30.0, HIT)
    assert panel.state == "armed"


def test_a_resumed_alarm_waits_for_its_acknowledgement():
    panel = AlarmPanel(AlarmPolicy(latch_s=30))
    panel.resume("human at 1 m")
    assert panel.state == "alarm"
    assert kinds(play(panel, [NOTHING] * 40)) == [(30, "end")]
    # Without a policy the verdict alone counts.
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
