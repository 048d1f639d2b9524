"""From port to stream: X2Radar against modules that answer late, wrongly or not at all."""

import itertools
import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.device_helpers import (
    HASTY,
    READY,
    SETTINGS,
    SHORT,
    FarEnd,
    WithoutReady,
    in_thread,
    obey,
    obey_but,
    raw,
    scripted,
    simulated,
    take,
    wire,
)
from tests.waiting import wait_for
from x2radar.device.device import X2Radar
from x2radar.device.link import RETRIES, Deadlines
from x2radar.device.transport import memory_pair
from x2radar.errors import (
    DeviceError,
    ReadTimeout,
    RestartRequired,
    SafeModeError,
    TransportClosed,
)
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module.faults import FaultPlan
from x2radar.sim.module.host import serve
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene
from x2radar.wire.messages import (
    Ack,
    Data,
    ErrorReply,
    Message,
    Ping,
    Pong,
    Reset,
    SetBaudRate,
    SetMode,
    SetOutput,
    SetSysInt,
    SystemMessage,
)
from x2radar.wire.wire_ids import ErrorCode, Mode, PongCode, SysCfg, SystemCode


def test_settings_become_commands_in_order() -> None:
    with scripted() as (radar, far):
        radar.open()
        assert far.commands[:2] == [Reset(), SetMode(Mode.IDLE)]
        assert far.commands[-1] == SetMode(Mode.MANUAL)
        assert SetSysInt(SysCfg.FPS, 60) in far.commands
        assert SetSysInt(SysCfg.FRAME_STITCH, 1) in far.commands
        assert isinstance(far.commands[-2], SetOutput)
        radar.close()
        far.join()
    assert far.commands[-1] == SetMode(Mode.IDLE)


def test_missed_ready_message_is_asked_for() -> None:
    with simulated("memory") as connect:
        radar = X2Radar(lambda: WithoutReady(connect()), SETTINGS, deadlines=SHORT)
        radar.open()
        assert len(take(radar, 2)) == 2
        radar.close()


def test_ready_from_before_the_reset_does_not_count() -> None:
    with scripted(obey_but(Reset, READY, Ack())) as (radar, far):
        radar.open()
        assert Ping() in far.commands


def test_silent_module() -> None:
    short = Deadlines(reply_s=0.03)
    with scripted(lambda _: [], short) as (radar, far):
        with pytest.raises(DeviceError, match="no answer to a reset"):
            radar.open()
        far.join()
        assert far.commands[:4] == [Reset()] * (1 + RETRIES)
        # The port is given back.
        with pytest.raises(TransportClosed):
            far.near.read(0)


def test_reset_is_sent_again_when_its_answer_is_lost() -> None:
    answers = itertools.chain([[]], itertools.repeat([Ack(), READY]))

    def answer(command: Message) -> list[Message]:
        return next(answers) if isinstance(command, Reset) else obey(command)

    with scripted(answer, Deadlines(reply_s=0.3)) as (radar, far):
        radar.open()
        assert far.commands[:2] == [Reset(), Reset()]


def silent_when_asked(command: Message) -> list[Message]:
    return [] if isinstance(command, Ping) else [Ack()]


def in_safe_mode(command: Message) -> list[Message]:
    return [Pong(PongCode.SAFE_MODE)] if isinstance(command, Ping) else [Ack()]


@pytest.mark.parametrize(
    ("answer", "deadlines", "error", "words"),
    [
        (
            silent_when_asked,
            Deadlines(ready_s=0.1, ping_every_s=0.02),
            DeviceError,
            r"not ready 0\.1 s after",
        ),
        (in_safe_mode, SHORT, SafeModeError, "fail-safe mode"),
        (obey_but(SetOutput), Deadlines(reply_s=0.3), DeviceError, "no answer to SetOutput"),
        (
            obey_but(SetOutput, ErrorReply(ErrorCode.BUSY)),
            HASTY,
            DeviceError,
            r"refused SetOutput.*\(busy\)",
        ),
        *(
            (obey_but(SetSysInt, ErrorReply(code)), SHORT, error, f"refused SetSysInt.*{words}")
            for code, error, words in (
                (ErrorCode.COMMAND_FAILED, DeviceError, r"0x21 \(command failed\)"),
                (ErrorCode.NOT_RECOGNIZED, DeviceError, r"0x1 \(not recognized\)"),
                (ErrorCode.RESTARTING, RestartRequired, r"0x22 \(restarting\)"),
                (0x77, DeviceError, r"0x77 \(unknown\)"),
            )
        ),
    ],
)
def test_why_a_module_does_not_start_is_said(answer, deadlines, error, words) -> None:
    with scripted(answer, deadlines) as (radar, _):
        with pytest.raises(error, match=words) as caught:
            radar.open()
        assert type(caught.value) is error


def once(command_type: type[Message], *answers: Message) -> Callable[[Message], list[Message]]:
    """Obey, but answer the first command of a type otherwise."""
    left = [list(answers)]

    def answer(command: Message) -> list[Message]:
        return left.pop() if left and isinstance(command, command_type) else obey(command)

    return answer


def test_a_lost_answer_is_asked_for_again_and_a_ping_draws_the_line() -> None:
    with scripted(once(SetSysInt), HASTY) as (radar, far):
        radar.open()
        first, second, ping, third = far.commands[2:6]
        assert first == second != third
        assert ping == Ping()
        assert far.commands[-1] == SetMode(Mode.MANUAL)
        assert radar.stats.retries == 1


def test_an_answer_that_comes_too_late_is_not_taken_for_the_next_ones() -> None:
    asked = []

    def answer(command: Message) -> list[Message]:
        if not isinstance(command, SetSysInt):
            return obey(command)
        asked.append(command)
        match len(asked):
            case 1:
                return []
            case 2:
                return [Ack(), Ack()]
            case 4:
                return [ErrorReply(ErrorCode.COMMAND_FAILED)]
        return [Ack()]

    with scripted(answer, HASTY) as (radar, _):
        with pytest.raises(DeviceError, match="refused") as caught:
            radar.open()
        assert SysCfg(asked[3].ref).name in str(caught.value)


def test_a_command_that_must_not_be_sent_twice_is_not() -> None:
    with scripted(obey_but(SetBaudRate), HASTY) as (radar, far):
        radar.open()
        with pytest.raises(DeviceError, match="no answer to SetBaudRate"):
            radar.command(SetBaudRate(921_600))
        assert sum(isinstance(c, SetBaudRate) for c in far.commands) == 1
        assert radar.stats.retries == 0


@pytest.mark.parametrize("code", [ErrorCode.BUSY, ErrorCode.CRC_FAILED])
def test_a_busy_module_is_asked_again(code: int) -> None:
    left = {SetOutput: 4, Reset: 3}

    def answer(command: Message) -> list[Message]:
        if left.get(type(command), 0):
            left[type(command)] -= 1
            return [ErrorReply(code)]
        return obey(command)

    with scripted(answer) as (radar, far):
        radar.open()
        assert far.commands.count(Reset()) == 4
        assert radar.stats.retries == 7


def test_a_module_that_wants_a_restart_is_reset_and_told_again_once() -> None:
    with scripted(once(SetOutput, ErrorReply(ErrorCode.RESTARTING))) as (radar, far):
        radar.open()
        second = far.commands.index(Reset(), 1)
        assert far.commands[:second][-1] != SetMode(Mode.MANUAL)
        assert far.commands[second + 1] == SetMode(Mode.IDLE)
        assert far.commands[-1] == SetMode(Mode.MANUAL)
    with scripted(obey_but(SetOutput, ErrorReply(ErrorCode.RESTARTING))) as (radar, far):
        with pytest.raises(RestartRequired):
            radar.open()
        assert far.commands.count(Reset()) == 2


def test_a_module_in_safe_mode_that_refuses_everything() -> None:
    def answer(command: Message) -> list[Message]:
        if isinstance(command, Ping):
            return [Pong(PongCode.SAFE_MODE)]
        return [ErrorReply(ErrorCode.COMMAND_FAILED)]

    with scripted(answer) as (radar, far):
        with pytest.raises(SafeModeError, match="power it off"):
            radar.open()
        assert far.commands == [Reset(), Ping()]


def test_a_reset_whose_answer_is_lost_shows_in_what_the_module_says() -> None:
    with scripted(obey_but(Reset, SystemMessage(SystemCode.BOOTING), READY), HASTY) as (
        radar,
        far,
    ):
        radar.open()
        assert far.commands.count(Reset()) == 1
        assert Ping() not in far.commands


def test_the_late_answer_to_a_ping_counts() -> None:
    pings = []

    def answer(command: Message) -> list[Message]:
        if isinstance(command, Ping):
            pings.append(command)
            if len(pings) > 1:
                return []
            threading.Timer(0.06, lambda: far.send(wire(Pong(PongCode.READY)))).start()
            return []
        return [Ack()]

    with scripted(answer, replace(SHORT, ping_every_s=0.04)) as (radar, far):
        radar.open()
        assert len(pings) <= 2


def test_a_module_that_streams_meanwhile_is_configured_and_its_old_frames_are_none() -> None:
    data = Data(0, 500, np.zeros(256, np.float32))

    def answer(command: Message) -> list[Message]:
        return [data, data, *obey(command), data] if command != start else obey(command)

    start = SetMode(Mode.MANUAL)
    with scripted(answer) as (radar, far):
        radar.open()
        far.send(raw(1))
        (frame,) = take(radar, 1)
        assert (frame.counter, frame.index, frame.restarted) == (1, 0, False)
        assert radar.stats.frames == 1


@pytest.mark.integration
def test_a_simulated_module_that_streams_already_is_taken_over() -> None:
    with simulated("pty", speed=1.0) as connect:
        transports = []
        left = X2Radar(lambda: transports.append(connect()) or transports[-1], SETTINGS)
        left.open()
        take(left, 2)
        # As after a kill: nobody tells the module to stop.
        transports[-1].close()
        with X2Radar(connect, SETTINGS) as radar:
            assert [f.index for f in take(radar, 3)] == [0, 1, 2]


def test_a_start_whose_answer_is_lost_is_not_made_twice() -> None:
    def answer(command: Message) -> list[Message]:
        if command == SetMode(Mode.MANUAL):
            return [Data(0, 1, np.zeros(256, np.float32))]
        return obey(command)

    with scripted(answer, HASTY) as (radar, far):
        radar.open()
        assert far.commands.count(SetMode(Mode.MANUAL)) == 1
        assert take(radar, 1)[0].counter == 1


@pytest.mark.parametrize("at", [SetSysInt, SetOutput])
def test_a_module_that_restarts_while_it_is_configured_is_told_from_the_beginning(at) -> None:
    with scripted(once(at, SystemMessage(SystemCode.BOOTING), READY, Ack())) as (radar, far):
        radar.open()
        assert far.commands.count(SetMode(Mode.IDLE)) == 2
        assert far.commands.count(SetMode(Mode.MANUAL)) == 1
    with (
        scripted(obey_but(at, READY, Ack())) as (radar, _),
        pytest.raises(DeviceError, match="again and again"),
    ):
        radar.open()


def test_opening_without_a_stream_tells_the_module_nothing() -> None:
    with scripted() as (radar, far):
        radar.open(stream=False)
        assert isinstance(radar.command(Ping()), Pong)
        radar.close()
        far.join()
        assert far.commands == [Ping()]


@pytest.mark.parametrize("answer", [lambda _: [], lambda _: [Ack()]], ids=["reset", "ready"])
def test_closing_from_another_thread_ends_the_opening(answer) -> None:
    with scripted(answer, Deadlines(reply_s=60, ready_s=60)) as (radar, _):
        caught = []

        def opening() -> None:
            with pytest.raises(TransportClosed) as error:
                radar.open()
            caught.append(error)

        thread = in_thread(opening)
        time.sleep(0.05)
        radar.close()
        thread.join(60)
        assert caught


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
