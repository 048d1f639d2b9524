"""The alarm panel against all that happened: what must be on is on, and nothing else ends it."""

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from radard.alarm.panel import AlarmPanel, AlarmPolicy, Sight
from tests.machine_helpers import machine_settings

DELAYS_S = st.sampled_from([0.0, 2.0, 10.0])
SIGHTS = st.sampled_from(
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

    @rule(after_s=st.sampled_from([1.0, 1.0, 1.0, 0.25, 7.0]), sight=SIGHTS, quiet=st.booleans())
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
