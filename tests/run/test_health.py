"""Health against a model: only decisions are a sign of life."""

from itertools import pairwise

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from radard.health.health import START_S, Health, Status, may_feed_all, overall
from radard.stream.ring import Notice
from tests.alarm_helpers import decision
from tests.machine_helpers import machine_settings

STALE_S = 5.0
# Only a decision, or a device that is back, ends a start or an absence.
CHANGES_NOTHING = {
    *(("start", "restart"), ("start", "found")),
    *(("lost", "restart"), ("failed", "restart")),
}


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


class HealthMachine(RuleBasedStateMachine):
    """Whatever happens to a stream; the model looks through all of it each time."""

    @initialize(stale_s=st.sampled_from([STALE_S, 40.0]))
    def begin(self, stale_s):
        self.clock, self.stale_s = Clock(), stale_s
        self.health = Health(stale_s=stale_s, clock=self.clock)
        self.told = "starting"
        self.past = [("start", self.clock.now_s, "")]
        self.wrong = {}

    def hear(self, status):
        expected = self.expected()
        if status is None:
            assert expected.state == self.told
        else:
            assert status == expected
            assert expected.state != self.told
        self.told = expected.state

    def happened(self, kind, status_of, reason=""):
        if not any(each == "end" for each, _, _ in self.past):
            self.past.append((kind, self.clock.now_s, reason))
        self.hear(status_of())

    @rule(late_s=st.sampled_from([0.0, 0.3, 4.0, 7.0]), fault=st.sampled_from(["", "9 missing"]))
    def decide(self, late_s, fault):
        made = decision(1, fault=fault, t_mono_s=self.clock.now_s - late_s)
        kind = "invalid" if fault else "decision"
        if not any(each == "end" for each, _, _ in self.past):
            self.past.append((kind, self.clock.now_s - late_s, fault))
        self.hear(self.health.on_decision(made))

    @rule(kind=st.sampled_from(["lost", "found", "restart", "paused"]))
    def notice(self, kind):
        before, _, _ = self.past[-1]
        status = self.health.on_notice(Notice(kind, f"it {kind}", 1.0))
        if (before, kind) in CHANGES_NOTHING:
            self.hear(status)
        else:
            self.happened(kind, lambda: status, kind)

    @rule()
    def fail(self):
        self.happened("failed", lambda: self.health.on_failure("fire"))

    @rule()
    def start(self):
        self.happened("start", self.health.on_start)

    @rule(source=st.sampled_from(["clips", "mqtt"]), reason=st.sampled_from(["", "full"]))
    def complain(self, source, reason):
        self.wrong.pop(source, None)
        if reason:
            self.wrong[source] = f"{source}: {reason}"
        self.hear(self.health.complain(source, reason))

    @rule(seconds=st.sampled_from([0.1, 1.0, 2.4, 4.9, 5.1, 15.1, 301.0]))
    def wait(self, seconds):
        self.clock.now_s += seconds

    @rule()
    def look(self):
        self.hear(self.health.check())

    @rule(ends=st.integers(0, 19))
    def end(self, ends):
        if ends == 0:
            self.happened("end", lambda: self.health.on_end("over"))

    def decided_at(self):
        return [n for n, (kind, _, _) in enumerate(self.past) if kind in {"decision", "invalid"}]

    def due_s(self):
        """When a decision is due at the latest: one wait after each, and one more for a return."""
        decided = self.decided_at()
        since = self.past[decided[-1] :] if decided else self.past
        first = self.past[decided[-1]][1] + self.stale_s if decided else 0.0
        due_s = first or self.past[0][1] + max(START_S, self.stale_s)
        has_waited = False
        for before, (kind, t_s, _) in pairwise(since):
            comes_back = kind == "found" and before[0] in {"lost", "failed"}
            if (comes_back or kind == "start") and not has_waited:
                has_waited = True
                due_s = t_s + (self.stale_s if comes_back else max(START_S, self.stale_s))
            elif kind == "paused":
                due_s = t_s + self.stale_s
        return due_s

    def expected(self):
        kind, _, reason = self.past[-1]
        if kind == "end":
            return Status("offline", "over")
        if kind == "lost":
            return Status("offline", f"device absent: it {reason}")
        if kind == "failed":
            return Status("offline", "fire")
        if self.clock.now_s > self.due_s():
            decided = self.decided_at()
            age_s = self.clock.now_s - self.past[decided[-1] if decided else 0][1]
            return Status("offline", f"no decision from fresh frames for {age_s:.0f} s")
        if kind == "start":
            return Status("starting", "waiting for the first dwell")
        said = {"decision": "", "invalid": reason}.get(kind, f"it {kind}")
        reasons = [*([said] if said else []), *self.wrong.values()]
        return Status("degraded" if reasons else "online", "; ".join(reasons))

    @invariant()
    def agrees_with_the_model(self):
        expected = self.expected()
        assert self.health.status == expected
        is_declared = self.past[-1][0] in {"lost", "failed"}
        assert self.health.may_feed is (expected.is_well or is_declared)
        assert self.health.is_over is (self.past[-1][0] == "end")

    @invariant()
    def nobody_is_called_well_without_decisions(self):
        decided = [t_s for kind, t_s, _ in self.past if kind in {"decision", "invalid"}]
        last_s = decided[-1] if decided else self.past[0][1]
        assert self.health.age_s == pytest.approx(self.clock.now_s - last_s, abs=1e-6)
        if not any(kind in {"found", "paused"} for kind, _, _ in self.past):
            longest_s = max(START_S, self.stale_s)
            assert not self.health.status.is_well or self.health.age_s <= longest_s


TestHealthMachine = HealthMachine.TestCase
TestHealthMachine.settings = machine_settings(25)


def test_every_change_is_told_by_what_makes_it():
    clock = Clock()
    health, waiting = Health(clock=clock), Health(clock=clock)
    assert health.on_decision(decision(1, t_mono_s=clock.now_s)) == Status("online", "")
    assert health.complain("mqtt", "full") == Status("degraded", "mqtt: full")
    assert health.complain("mqtt", "") == Status("online", "")
    clock.now_s += 5.0
    assert health.check() is None
    clock.now_s += 0.1
    assert health.check().state == "offline"
    health.on_notice(Notice("lost", "unplugged", 1.0))
    # Back, it has as long again.
    assert health.on_notice(Notice("found", "back", 1.0)) == Status("degraded", "back")
    clock.now_s += 9.9
    assert waiting.on_notice(Notice("restart", "again", 1.0)) is None
    clock.now_s += 0.1
    assert waiting.on_notice(Notice("restart", "again", 1.0)).state == "offline"


@pytest.mark.parametrize(
    ("states", "whole", "reason"),
    [
        (("online", "online"), "online", ""),
        (("online", "degraded"), "degraded", "b: degraded: degraded"),
        (("offline", "online"), "degraded", "a: offline: offline"),
        (("offline", "offline"), "offline", "a: offline: offline; b: offline: offline"),
        (("starting", "offline"), "starting", "a: starting: starting; b: offline: offline"),
        (("degraded",), "degraded", "degraded"),
    ],
)
def test_several_states_make_one(states, whole, reason):
    class Fixed:
        def __init__(self, state):
            self.status = Status(state, "" if state == "online" else state)

    healths = {name: Fixed(state) for name, state in zip("ab", states, strict=False)}
    assert overall(healths) == Status(whole, reason)


def test_an_output_in_trouble_does_not_hide_that_a_run_is_over():
    """100,000 steps of the machine found it: a run that ended was told as degraded."""
    health = Health(stale_s=STALE_S)
    health.complain("clips", "full")
    assert health.on_end("over") == Status("offline", "over")
    assert health.on_end("again") is None


def test_the_watchdog_is_fed_for_all_that_go_on():
    clock = Clock()
    fresh, away, over = (Health(stale_s=STALE_S, clock=clock) for _ in range(3))
    fresh.on_decision(decision(1, t_mono_s=clock.now_s))
    away.on_failure("it broke")
    over.on_end("end of stream")
    assert may_feed_all([fresh, away, over])
    assert not may_feed_all([over])
    away.on_start()
    assert not may_feed_all([fresh, away, over])
    away.on_decision(decision(1, t_mono_s=clock.now_s))
    assert may_feed_all([fresh, away, over])
    clock.now_s += 6
    assert not may_feed_all([fresh, away, over])
