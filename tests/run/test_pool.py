"""The pool of workers: every radar's items in order, none kept from its turn by another."""

import threading
import time
from collections import deque
from itertools import pairwise

from radard.run.pool import WorkerPool
from tests.waiting import wait_for


class Radar:
    """Items that are worked on, and what came of it."""

    def __init__(self, pool):
        self.waiting, self.done = deque(), []
        self.alone = threading.Lock()
        self.pool = pool

    def give(self, item):
        self.waiting.append(item)
        self.pool.ask(self.step)

    def step(self):
        # Never two at the same time.
        assert self.alone.acquire(blocking=False)
        try:
            if not self.waiting:
                return False
            self.done.append(self.waiting.popleft())
            return True
        finally:
            self.alone.release()


def test_items_of_many_radars_come_in_order_and_all_of_them():
    pool = WorkerPool()
    radars = [Radar(pool) for _ in range(12)]
    pool.fit(len(radars))

    def give(seed):
        for k in range(200):
            for radar in radars[seed::3]:
                radar.give((seed, k))

    threads = [threading.Thread(target=give, args=(seed,)) for seed in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wait_for(lambda: not any(radar.waiting for radar in radars))
    wait_for(lambda: all(radar.done == sorted(radar.done) for radar in radars))
    assert all(len(radar.done) == 200 for radar in radars)
    pool.close()


def test_one_that_stands_still_stops_no_other_and_is_made_good():
    pool, gate = WorkerPool(), threading.Event()
    pool.fit(1)
    pool.ask(lambda: gate.wait(60) and False)
    other = Radar(pool)
    other.give(1)
    pool.grow()
    wait_for(lambda: other.done == [1])
    gate.set()
    pool.close()


def test_nobody_has_two_turns_before_another_has_one():
    pool, order = WorkerPool(), []
    left = {"a": 3, "b": 3}

    def step(name):
        order.append(name)
        left[name] -= 1
        return left[name] > 0

    for name in left:
        pool.ask(lambda name=name: step(name))
    pool.fit(1)
    wait_for(lambda: not any(left.values()))
    assert order == ["a", "b"] * 3
    pool.close()


def test_turns_come_when_they_were_asked_for_one_for_each_time():
    pool, came = WorkerPool(), []

    def step():
        came.append(time.monotonic())
        if len(came) < 4:
            # The earlier one counts.
            pool.ask_in(step, 60.0)
            pool.ask_in(step, 0.05)
        return False

    pool.fit(2)
    pool.ask(step)
    wait_for(lambda: len(came) == 4)
    assert min(b - a for a, b in pairwise(came)) >= 0.05
    pool.ask(step)
    wait_for(lambda: len(came) == 5)
    pool.close()


def test_times_are_heeded_while_one_thread_hangs_and_another_radar_never_rests():
    pool, gate, came = WorkerPool(), threading.Event(), []

    def tick():
        came.append(1)
        pool.ask_in(tick, 0.01)
        return False

    pool.fit(2)
    pool.ask(tick)
    wait_for(lambda: len(came) > 2)
    pool.ask(lambda: gate.wait(60) and False)
    pool.ask(lambda: not gate.is_set())
    n = len(came)
    wait_for(lambda: len(came) > n + 5)
    gate.set()
    pool.close()


def test_streams_begin_apart_and_the_first_at_once():
    pool = WorkerPool()
    before_s = time.monotonic()
    begin_s = [pool.begin_s() for _ in range(100)]
    assert begin_s[0] - before_s < 0.1
    assert all(0 <= each - before_s < 2.0 for each in begin_s)
    phases = sorted((each - begin_s[0]) % 1.0 for each in begin_s)
    apart = [b - a for a, b in pairwise([*phases, phases[0] + 1.0])]
    assert min(apart) > 0.002
    assert max(apart) < 0.03
