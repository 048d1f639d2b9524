"""The driver, and whoever opens the terminal, survive a module that misbehaves."""

import itertools

import numpy as np
import pytest

from tests.device_helpers import faulty
from x2radar.device.link import Deadlines
from x2radar.modules.x2 import RadarSettings
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import load_scene

SCENE = load_scene("human")
QUICK = Deadlines(reply_s=0.5, ready_s=3, ping_every_s=0.05, stall_s=0.5)


@pytest.fixture(scope="module")
def told():
    """The scene's frames by counter from 1; the driver tells the delay as a float32."""
    settings = RadarSettings(sample_delay_s=float(np.float32(4e-9)))
    stream = EchoStream(SCENE, 0, settings)
    return [stream.next() for _ in range(1500)]


def frames(faults, n):
    """The first frames that the driver hands out of a module with faults."""
    with make_radar(parse_port(f"sim:human?fault={faults}"), speed=None) as radar:
        return list(itertools.islice(radar.frames(), n))


def is_made(frame, told):
    return 0 < frame.counter <= len(told) and np.array_equal(
        frame.samples, told[frame.counter - 1]
    )


def assert_counted(got):
    """Every frame says what is missing before it, as its counter has it."""
    for before, frame in itertools.pairwise(got):
        if frame.restarted:
            assert frame.counter <= before.counter
            assert (frame.lost, frame.index) == (0, before.index + 1)
        else:
            assert frame.lost == frame.counter - before.counter - 1
            assert frame.index == before.index + frame.lost + 1


@pytest.mark.parametrize(
    "faults",
    [
        *("drop_bytes:1e-4", "junk:0.1", "split:7", "merge:0.2", "slow_ack:0.1"),
        "drop_bytes:1e-5,junk:0.05,drop_frames:0.1,duplicate:0.1,split:900,bursts:1",
    ],
)
def test_true_frames_only_and_what_is_missing_is_said(faults, told):
    got = frames(faults, 60 if faults == "split:7" else 400)
    assert got[0].index == 0
    assert not any(frame.restarted for frame in got)
    assert_counted(got)
    assert all(is_made(frame, told) for frame in got)
    loses = faults.startswith("drop")
    assert (got[-1].index > len(got) - 1) == loses or faults == "junk:0.1"


def test_flipped_bits_pass_only_where_the_checksum_is_blind(told):
    got = frames("flip_bits:1e-4", 500)
    assert_counted(got)
    assert any(frame.lost for frame in got)
    wrong = [frame for frame in got if not is_made(frame, told)]
    # Two flips of the same bit cancel in a XOR of bytes: 0.4 % of packets at this rate.
    assert len(wrong) <= 0.012 * len(got)
    for frame in wrong:
        assert (frame.samples != told[frame.counter - 1]).sum() <= 2
    # A module that reboots is heard again.
    got = frames("reboot:0.01", 400)
    assert_counted(got)
    assert 1 <= sum(frame.restarted for frame in got) <= 12
    assert all(is_made(frame, told) for frame in got)


SLOW = [("slow_ack:0.1", None), ("slow_ack:0.03", 1.0), ("not_ready:0.3", 1.0)]


@pytest.mark.parametrize(("faults", "speed"), [*SLOW, ("not_ready:100", None)])
def test_it_opens_all_the_same(faults, speed):
    with faulty(faults, speed, deadlines=QUICK) as radar:
        assert next(radar.frames()).index == 0
