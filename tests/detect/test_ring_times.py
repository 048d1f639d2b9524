"""When dwells are due, and when their last frames came."""

from dataclasses import replace

import numpy as np
import pytest

from tests.radar_helpers import copy_ring, frames_of, noise

RATE_HZ = 60.0


def timed(samples, first_s, *, late_s=0.0):
    """Frames that arrive on the host's clock in time, the first at `first_s`, all so late."""
    for frame in frames_of(samples):
        yield replace(frame, t_mono_s=first_s + frame.index / RATE_HZ + late_s)


def test_the_next_dwell_is_due_when_its_last_frame_arrives():
    ring = copy_ring(30, RATE_HZ)
    for frame in timed(noise(20), 100.0):
        # A frame that its reader found late says nothing.
        ring.push(replace(frame, t_mono_s=frame.t_mono_s + 0.1 * (frame.index % 3 > 0)))
    assert ring.due_s() == pytest.approx(100 + 29 / RATE_HZ)
    for frame in list(timed(noise(40), 100.0))[20:]:
        ring.push(frame)
    assert ring.due_s() == pytest.approx(100 + 89 / RATE_HZ)
    # A clock that runs apart is followed within two hops.
    ring = copy_ring(30, RATE_HZ)
    for frame in timed(noise(400), 100.0):
        ring.push(replace(frame, t_mono_s=frame.t_mono_s + 0.01 * (frame.index >= 100)))
        while ring._queue:
            ring.next_item(0)
    assert ring.due_s() == pytest.approx(100.01 + (30 + 60 * 7 - 1) / RATE_HZ)
    # After a restart the old times do not count.
    ring = copy_ring(30, RATE_HZ)
    for frame in timed(noise(20), 100.0):
        late_s = 5.0 * (frame.index >= 10)
        ring.push(replace(frame, t_mono_s=frame.t_mono_s + late_s, restarted=frame.index == 10))
    assert ring.due_s() == pytest.approx(105 + 39 / RATE_HZ)


@pytest.mark.parametrize("way", ["push", "items"])
def test_a_dwell_that_ends_with_a_lost_frame_has_no_time_of_arrival(way):
    ring = copy_ring(10, RATE_HZ)
    got = []
    for frame in timed(np.delete(noise(11), 9, axis=0), 100.0):
        frame = replace(frame, lost=int(frame.index == 9))  # noqa: PLW2901 - one number on
        if way == "push":
            ring.push(frame)
        else:
            got += ring.items(frame)
    got = got or [ring.next_item(0)]
    assert got[0].t_mono_s == 0.0
    assert got[0].n_lost == 1
