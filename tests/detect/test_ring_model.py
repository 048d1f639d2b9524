"""The ring against plain lists: frames, losses, restarts and readers in any order."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from radard.stream.ring import Dwell
from tests.detect.test_ring import schedule
from tests.machine_helpers import machine_settings
from tests.radar_helpers import BASEBAND, copy_ring
from x2radar.frame import Frame

N_RANGE = BASEBAND.n_range


class RingMachine(RuleBasedStateMachine):
    """Every frame holds its own number, so a row that is not its own is seen."""

    @initialize(
        n_slow=st.integers(2, 40),
        rate=st.integers(1, 30),
        hop_s=st.sampled_from([0.25, 1.0, 2.0]),
        index=st.sampled_from([0, 10**5, 10**9]),
    )
    def begin(self, n_slow, rate, hop_s, index):
        hop_s = max(hop_s, 1 / rate)
        self.n_slow, self.rate, self.hop_s = n_slow, rate, hop_s
        self.ring = copy_ring(n_slow, rate, hop_s)
        self.n, self.index = 0, index
        self.rows, self.good, self.base = [], [], 0
        self.ends, self.notices = [], []

    def push(self, *, lost=0, is_restart=False, is_bad=False):
        self.n += 1
        samples = np.full(N_RANGE, np.nan if is_bad else self.n, np.complex64)
        self.index += lost + 1
        if is_restart and self.rows:
            self.look_at_the_end()
            self.base += len(self.rows)
            self.rows, self.good, self.ends = [], [], []
            self.notices.append("restart")
        elif self.rows:
            for _ in range(lost):
                self.rows.append(self.rows[-1])
                self.good.append(False)
        # What was lost before a stream begins is not counted.
        frame = Frame(samples, self.index, self.index, lost, is_restart, BASEBAND, 0.0)
        last = self.rows[-1] if self.rows else 0
        self.rows.append(last if is_bad else self.n)
        self.good.append(not is_bad)
        for item in self.ring.items(frame):
            if isinstance(item, Dwell):
                self.look_at(item)
            else:
                assert item.kind == self.notices.pop(0)

    def look_at(self, dwell):
        end = len(self.rows) - round((self.index + 1) - dwell.t_s * self.rate)
        first = end - self.n_slow
        assert first >= 0
        assert dwell.frames[:, 0].real.tolist() == self.rows[first:end]
        assert dwell.valid.tolist() == self.good[first:end]
        assert dwell.n_lost == self.good[first:end].count(False)
        runs = "".join(" x"[not good] for good in self.good[first:end]).split()
        assert round(dwell.longest_gap_s * self.rate) == max(map(len, runs), default=0)
        self.ends.append(end)

    def look_at_the_end(self):
        if self.hop_s == 1.0:
            assert self.ends == schedule(np.array(self.good), self.n_slow, self.rate)

    @rule(n=st.integers(1, 60))
    def frames(self, n):
        for _ in range(n):
            self.push()

    @rule(lost=st.integers(1, 90))
    def lose(self, lost):
        self.push(lost=lost)

    @rule(lost=st.integers(0, 9))
    def restart(self, lost):
        self.push(lost=lost, is_restart=True)

    @rule()
    def spoil(self):
        self.push(is_bad=True)

    @rule()
    def post(self):
        self.notices.append("command")
        self.ring.post("command", "arm")

    @rule()
    def look_on(self):
        recent = self.ring.recent()
        begin = recent.end_frame - len(recent.frames) - recent.begun_at
        end = recent.end_frame - recent.begun_at
        if begin >= 0 and recent.begun_at == self.base:
            assert recent.frames[:, 0].real.tolist() == self.rows[begin:end]
            assert recent.valid.tolist() == self.good[begin:end]

    def teardown(self):
        if hasattr(self, "ring"):
            self.look_at_the_end()


TestRingMachine = RingMachine.TestCase
TestRingMachine.settings = machine_settings()
