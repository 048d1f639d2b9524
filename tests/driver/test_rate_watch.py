"""RateWatch: a module that sends at another rate than it was set to is a fault."""

import pytest

from radard.stream.frame_timing import RateWatch
from tests.device_helpers import plugged
from tests.radar_helpers import run_radard

pytestmark = pytest.mark.integration


def said(pace, n=30, late=lambda _k: 0.0):
    watch = RateWatch(60.0)
    return [watch.note(k, 100 + k / pace + late(k)) for k in range(n)]


@pytest.mark.parametrize("pace", [0.5, 0.85, 1.15, 2.0])
def test_another_rate_is_said_after_ten_seconds_of_the_stream(pace):
    reasons = said(pace)
    assert not any(reasons[:10])
    assert all(f"{60 * pace:.3g} Hz, not at 60 Hz" in reason for reason in reasons[10:])


@pytest.mark.parametrize("pace", [0.95, 1.0, 1.05])
def test_clocks_may_differ_and_hosts_may_pause(pace):
    assert not any(said(pace))
    assert not any(said(1.0, late=lambda k: 30.0 if k >= 15 else 0.0))
    assert not any(said(1.0, late=lambda k: 3.0 if k == 15 else 0.0))


def test_an_interruption_begins_it_again_and_recordings_have_no_clock():
    watch = RateWatch(60.0)
    for k in range(10):
        assert watch.note(k, 100 + 2 * k) == ""
    watch.reset()
    assert watch.note(10, 120) == ""
    assert not any(watch.note(k, 0.0) for k in range(30))


def test_a_module_at_thrice_its_rate_is_degraded_and_a_fault():
    with plugged(speed=3.0) as pty:
        argv = ("--port", pty.path, "-o", "json", "--duration", "16", "--model", "none")
        code, records, _ = run_radard(*argv)
    assert code == 0
    faults = [r for r in records if r["type"] == "event" and r["kind"] == "fault"]
    assert faults
    assert "not at 60 Hz" in faults[0]["reason"]
    told = [r for r in records if r["type"] == "status" and r["state"] == "degraded"]
    assert "not at 60 Hz" in told[0]["reason"]
