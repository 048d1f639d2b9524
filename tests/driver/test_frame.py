"""Axes, and the counter that orders frames."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from x2radar.frame import CounterTracker, FastTimeAxis, Step

AXIS = FastTimeAxis(kind="rf", n_range=4, bin_length_m=0.5, range_offset_m=2.0, carrier_hz=6.8e9)
TOP = 2**32 - 1


def track(counters: list[int], longest_gap: int = 36_000) -> list[tuple[Step, int, int]]:
    tracker = CounterTracker(longest_gap)
    return [(*tracker.update(c), tracker.index) for c in counters]


def test_range_axis() -> None:
    np.testing.assert_array_equal(AXIS.range_m, [2.0, 2.5, 3.0, 3.5])
    assert AXIS.range_m.dtype == np.float64
    assert AXIS.range_m is AXIS.range_m


def test_range_axis_of_an_empty_frame() -> None:
    assert dataclasses.replace(AXIS, n_range=0).range_m.shape == (0,)


@pytest.mark.parametrize(
    ("counters", "expected"),
    [
        pytest.param(
            [7, 8, 9],
            [(Step.FIRST, 0, 0), (Step.NEXT, 0, 1), (Step.NEXT, 0, 2)],
            id="one after another",
        ),
        pytest.param([1, 4], [(Step.FIRST, 0, 0), (Step.GAP, 2, 3)], id="two lost"),
        pytest.param(
            [5, 5, 6], [(Step.FIRST, 0, 0), (Step.REPEAT, 0, 0), (Step.NEXT, 0, 1)], id="repeat"
        ),
        pytest.param(
            [500, 1, 2],
            [(Step.FIRST, 0, 0), (Step.RESTART, 0, 1), (Step.NEXT, 0, 2)],
            id="the module restarted",
        ),
        pytest.param(
            [TOP - 1, TOP, 0, 1],
            [(Step.FIRST, 0, 0), (Step.NEXT, 0, 1), (Step.NEXT, 0, 2), (Step.NEXT, 0, 3)],
            id="the counter wraps",
        ),
        pytest.param([TOP, 2], [(Step.FIRST, 0, 0), (Step.GAP, 2, 3)], id="lost at the wrap"),
        pytest.param([1, 0], [(Step.FIRST, 0, 0), (Step.RESTART, 0, 1)], id="one back"),
    ],
)
def test_steps(counters: list[int], expected: list) -> None:
    assert track(counters) == expected


def test_longest_gap_is_a_gap_and_one_more_a_restart() -> None:
    assert track([0, 11], longest_gap=10)[1] == (Step.GAP, 10, 11)
    assert track([0, 12], longest_gap=10)[1] == (Step.RESTART, 0, 1)


@given(
    first=st.integers(0, TOP),
    ahead=st.lists(st.one_of(st.integers(0, 3), st.integers(1, 100)), max_size=30),
)
def test_index_counts_what_was_sent(first: int, ahead: list[int]) -> None:
    tracker = CounterTracker()
    tracker.update(first)
    index, lost = 0, 0
    for step in ahead:
        index += step
        lost += max(step - 1, 0)
        kind, missing = tracker.update((first + index) % 2**32)
        assert tracker.index == index
        assert missing == max(step - 1, 0)
        assert (kind is Step.REPEAT) == (step == 0)
        assert (kind is Step.GAP) == (step > 1)
