"""The alarm panel: by examples, and against all that happened in any order."""

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from radard.alarm.panel import AlarmPanel, AlarmPolicy, Sight
from tests.machine_helpers import machine_settings

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
        ({"k": 2, "n": 3, **OF_N}, "h..hh", "5 new"),
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


DELAYS_S = st.sampled_from([0.0, 2.0, 10.0])
ANY_SIGHT = st.sampled_from(
    [Sight(True, True, "human"), Sight(False, True, "seen"), Sight(False, False, "none"), None]
)
POLICIES = st.builds(
    AlarmPolicy,
    k=st.integers(1, 3),
    n=st.integers(3, 6),
    exit_delay_s=DELAYS_S,
    entry_delay_s=DELAYS_S,
    latch_s=DELAYS_S,
    refractory_s=DELAYS_S,
)


class PanelMachine(RuleBasedStateMachine):
    """Stream time goes on from one thing to the next, from any beginning."""

    @initialize(policy=POLICIES, t_s=st.sampled_from([0.0, 1e5, 1e9]), is_armed=st.booleans())
    def begin(self, policy, t_s, is_armed):
        self.policy = policy
        self.panel = AlarmPanel(self.policy, is_armed=is_armed)
        self.t_s = t_s
        self.ready_s = float("-inf")  # when an alarm may begin, and hits began to count
        self.hits = []  # since then
        self.exit_s = None  # when an exit delay is over
        self.entry_s = None  # when an entry delay is
        self.is_on = self.is_seen = False
        self.seen_s = 0.0  # when somebody was seen last, or could have been

    def told(self, changes, *kinds):
        assert tuple(change.kind for change in changes) == kinds

    def over(self):
        self.is_on, self.hits = False, []
        self.ready_s = self.t_s + self.policy.refractory_s

    def start(self, sight=None):
        self.is_on, self.entry_s, self.seen_s = True, None, self.t_s
        self.is_seen = sight is None or sight.is_seen  # where nobody knows, somebody is there

    @rule(
        after_s=st.sampled_from([1.0, 1.0, 1.0, 0.25, 7.0]), sight=ANY_SIGHT, quiet=st.booleans()
    )
    def see(self, after_s, sight, quiet):
        self.t_s += after_s
        was = self.panel.state
        changes = self.panel.on_sight(self.t_s, sight, is_quiet=quiet)
        if was == "alarm":
            self.see_on(changes, sight)
            return
        begins = False
        if was == "exit":
            self.exit_s = None if self.t_s >= self.exit_s else self.exit_s
        elif was != "disarmed":
            self.hits += [sight.is_hit and not quiet] if sight is not None else []
            is_confirmed = sum(self.hits[-self.policy.n :]) >= self.policy.k
            if self.entry_s is None and is_confirmed and self.t_s >= self.ready_s:
                self.entry_s = self.t_s + self.policy.entry_delay_s
            begins = self.entry_s is not None and self.t_s >= self.entry_s
        self.told(changes, *["new"] * begins)
        if begins:
            self.start(sight)

    def see_on(self, changes, sight):
        is_there = sight is None or sight.is_seen
        self.seen_s = self.t_s if is_there else self.seen_s
        if not is_there and self.t_s - self.seen_s >= self.policy.latch_s:
            self.told(changes, "end")
            self.over()
            return
        was_seen = self.is_seen
        # One window in which somebody is missed does not say that they left.
        if sight is not None and (is_there or self.t_s - self.seen_s >= 3.0):
            self.is_seen = is_there
        self.told(changes, *["update"] * (self.is_seen != was_seen))

    @rule()
    def lose(self):
        changes = self.panel.on_loss(self.t_s)
        self.exit_s = None
        if self.entry_s is not None:
            self.told(changes, "new")
            assert "the sensor was lost" in changes[0].reason
            self.start()
        else:
            self.told(changes)

    @rule(mode=st.sampled_from(["away", "home"]))
    def arm(self, mode):
        was, before = self.panel.state, self.panel.mode
        self.told(self.panel.arm(self.t_s, mode))
        if was in {"entry", "alarm"} or (was != "disarmed" and before == mode):
            assert (self.panel.state, self.panel.mode) == (was, before)
            return
        assert self.panel.mode == mode
        self.hits, self.ready_s = [], float("-inf")
        if self.exit_s is None and self.policy.exit_delay_s:
            self.exit_s = self.t_s + self.policy.exit_delay_s

    @rule()
    def disarm(self):
        self.told(self.panel.disarm(), *["end"] * self.is_on)
        self.is_on, self.exit_s, self.entry_s = False, None, None
        assert self.panel.state == "disarmed"

    @rule()
    def acknowledge(self):
        self.told(self.panel.acknowledge(self.t_s), *["end"] * self.is_on)
        if self.is_on:
            self.over()

    @invariant()
    def agrees(self):
        state, left_s = self.panel.state, self.panel.left_s(self.t_s)
        assert (state == "alarm") == self.is_on
        assert (state == "entry") == (self.entry_s is not None)
        assert (state == "exit") == (self.exit_s is not None)
        assert self.panel.is_armed == (state != "disarmed")
        assert self.panel.is_seen == (self.is_on and self.is_seen)
        assert (self.panel.entry_reason is None) == (state != "entry")
        ends_s = self.exit_s if state == "exit" else self.entry_s
        assert left_s == (None if ends_s is None else max(0.0, ends_s - self.t_s))


TestPanelMachine = PanelMachine.TestCase
TestPanelMachine.settings = machine_settings()
