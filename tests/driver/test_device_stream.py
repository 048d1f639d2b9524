"""What X2Radar makes of losses, damage, stalls and restarts in mid-stream."""

import time
from dataclasses import replace

import pytest

from tests.device_helpers import (
    READY,
    SETTINGS,
    SHORT,
    FarEnd,
    in_thread,
    obey,
    raw,
    scripted,
    simulated,
    take,
    wire,
)
from tests.waiting import wait_for
from x2radar.device.device import X2Radar
from x2radar.device.transport import memory_pair
from x2radar.errors import ReadTimeout, TransportClosed
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module.faults import FaultPlan
from x2radar.sim.module.host import serve
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene
from x2radar.wire.messages import Ping, Reset, SetMode, SystemMessage
from x2radar.wire.wire_ids import Mode, SystemCode


def test_losses_and_damage_are_stated() -> None:
    with scripted() as (radar, far):
        radar.open()
        damaged = bytearray(raw(2))
        damaged[20] ^= 1
        far.send(raw(1) + bytes(damaged) + raw(3) + raw(3) + raw(1))
        frames = take(radar, 3)
        assert [(f.counter, f.index, f.lost, f.restarted) for f in frames] == [
            (1, 0, 0, False),
            (3, 2, 1, False),
            (1, 3, 0, True),
        ]
        stats = radar.stats
        assert (stats.frames, stats.lost, stats.repeated, stats.restarts, stats.damaged) == (
            *(3, 1, 1, 1, 1),
        )


def test_stall() -> None:
    with scripted() as (radar, far):
        radar.open()
        far.send(raw(1))
        frames = radar.frames()
        assert next(frames).counter == 1
        with pytest.raises(ReadTimeout, match=r"no frame for 0\.1 s"):
            next(frames)


def test_three_frames_of_a_slow_stream_are_no_stall() -> None:
    far = FarEnd(obey)
    with (
        X2Radar(lambda: far.near, RadarSettings(frame_rate_hz=10), deadlines=SHORT) as radar,
        pytest.raises(ReadTimeout, match=r"no frame for 0\.3 s"),
    ):
        next(radar.frames())
    far.close()


@pytest.mark.parametrize(
    "said", [(SystemMessage(SystemCode.BOOTING), READY), (READY,)], ids=["both", "ready"]
)
def test_a_module_that_restarts_in_mid_stream_is_told_again_and_its_frames_marked(said) -> None:
    with scripted(deadlines=replace(SHORT, stall_s=60.0)) as (radar, far):
        radar.open()
        frames = iter(radar)
        far.send(raw(1) + raw(2))
        before = [next(frames), next(frames)]
        n_told, start = len(far.commands), far.commands[-1]
        # It streams by itself, with settings that it has not been told yet.
        far.send(wire(*said) + raw(3))
        in_thread(lambda: (wait_for(lambda: start in far.commands[n_told:]), far.send(raw(3))))
        after = next(frames)
        assert Reset() not in far.commands[n_told:]
        assert far.commands[n_told] == SetMode(Mode.IDLE)
        assert (after.index, after.restarted, after.lost) == (2, True, 0)
        far.send(raw(4))
        assert (next(frames).index, radar.stats.restarts) == (3, 1)
    assert [f.restarted for f in before] == [False, False]


def test_a_simulated_module_that_reboots_again_and_again_streams_on() -> None:
    plan = FaultPlan({"reboot": 0.01})
    patient = replace(SHORT, stall_s=60.0)
    near, far = memory_pair()
    thread = in_thread(serve, SimulatedModule(load_scene("human"), 3, plan), far, speed=4.0)
    with X2Radar(lambda: near, SETTINGS, deadlines=patient) as radar:
        frames = take(radar, 400)
        stats = radar.stats
    far.close()
    thread.join(60)
    indexes = [f.index for f in frames]
    assert indexes == sorted(set(indexes))
    assert stats.restarts >= 2
    assert stats.frames >= 400


@pytest.mark.integration
def test_numbers_and_stats_go_on_over_all_openings() -> None:
    with simulated("pty") as connect:
        radar = X2Radar(connect, SETTINGS)
        last = -1
        for open_it in (radar.open, radar.reopen):
            open_it()
            frames = take(radar, 3)
            assert frames[0].index > last or open_it == radar.open
            assert [f.restarted for f in frames] == [last >= 0, False, False]
            last = frames[-1].index
            stats = radar.stats
            radar.close()
    assert stats.frames >= 6
    assert (stats.lost, stats.damaged, stats.reconnects) == (0, 0, 1)
    with pytest.raises(AttributeError):
        stats.frames = 0


def test_slow_reader_is_no_stall() -> None:
    with scripted() as (radar, far):
        radar.open()
        far.send(raw(1))
        frames = radar.frames()
        next(frames)
        far.send(raw(2))
        time.sleep(1.5 * SHORT.stall_s)
        assert next(frames).counter == 2


@pytest.mark.parametrize("kind", ["memory", pytest.param("pty", marks=pytest.mark.integration)])
def test_port_closed_in_mid_stream(kind: str) -> None:
    # Slow enough that the module does not fill the line before it is closed.
    with simulated(kind, speed=1.0) as connect:
        radar = X2Radar(connect, SETTINGS)
        radar.open()
        frames = radar.frames()
        next(frames)
    with pytest.raises(TransportClosed):
        list(frames)
    radar.close()


def test_closed_radar() -> None:
    radar = X2Radar(lambda: memory_pair()[0], SETTINGS, name="mine")
    radar.close()
    with pytest.raises(TransportClosed, match="mine is not open"):
        next(radar.frames())
    with pytest.raises(TransportClosed, match="mine is not open"):
        radar.command(Ping())
