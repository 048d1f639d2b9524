"""From port to stream: X2Radar against modules that answer late, wrongly or not at all."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests import device_helpers as device
from tests.device_helpers import HASTY, READY, SHORT, obey, obey_but, raw, scripted, take
from tests.waiting import wait_for
from x2radar import errors
from x2radar.device.device import X2Radar
from x2radar.device.link import RETRIES, Deadlines
from x2radar.errors import DeviceError, ReadTimeout, TransportClosed
from x2radar.modules.x2 import RadarSettings
from x2radar.wire import framing
from x2radar.wire import messages as msg
from x2radar.wire.wire_ids import ErrorCode, Mode, PongCode, SysCfg, SystemCode

Answer = Callable[[msg.Message], list[msg.Message]]
IDLE, START = msg.SetMode(Mode.IDLE), msg.SetMode(Mode.MANUAL)


def turns(kind: type[msg.Message], *answers: list[msg.Message]) -> Answer:
    """Answer the first commands of a type as given, one a turn; obey otherwise."""
    left = list(answers)
    return lambda command: left.pop(0) if left and isinstance(command, kind) else obey(command)


def test_settings_become_commands_in_order() -> None:
    with scripted() as (radar, far):
        radar.open()
        radar.close()
        far.join()
    told = msg.Reset(), *device.SETTINGS.startup_commands(), IDLE
    assert device.wire(*far.commands) == device.wire(*told)


BUSY = [msg.ErrorReply(ErrorCode.BUSY)]
BOOTING = msg.SystemMessage(SystemCode.BOOTING)
RESTARTING = [msg.ErrorReply(ErrorCode.RESTARTING)]
NOT_READY = [msg.Pong(PongCode.NOT_READY)]
DAMAGED = [msg.ErrorReply(ErrorCode.CRC_FAILED)]
FRAME = msg.Data(0, 1, np.zeros(256, np.float32))


def asleep() -> Answer:
    pings = turns(msg.Ping, NOT_READY, NOT_READY)
    return lambda command: [msg.Ack()] if command == msg.Reset() else pings(command)


OPENINGS = {
    "a READY from before the reset says nothing": (
        lambda: obey_but(msg.Reset, READY, msg.Ack()),
        {msg.Ping(): 1},
    ),
    "who is not ready is asked again": (asleep, {msg.Ping(): 3}),
    "a lost reset is sent again": (lambda: turns(msg.Reset, []), {msg.Reset(): 2}),
    "a reset whose answer is lost shows": (
        lambda: obey_but(msg.Reset, BOOTING, READY),
        {msg.Reset(): 1, msg.Ping(): 0},
    ),
    "a busy module is asked again": (lambda: turns(msg.Reset, BUSY, BUSY, BUSY), {msg.Reset(): 4}),
    "so is one that took no command": (lambda: turns(msg.Reset, DAMAGED), {msg.Reset(): 2}),
    "who wants a restart is told all again": (
        lambda: turns(msg.SetOutput, RESTARTING),
        {msg.Reset(): 2, IDLE: 2},
    ),
    "who restarts is told all again": (
        lambda: turns(msg.SetSysInt, [BOOTING, READY, msg.Ack()]),
        {IDLE: 2, START: 1, msg.Reset(): 1},
    ),
    "where frames come, only an answer was lost": (
        lambda: lambda command: [FRAME] if command == START else obey(command),
        {START: 1},
    ),
}


@pytest.mark.parametrize(("answer", "counts"), OPENINGS.values(), ids=OPENINGS)
def test_an_opening_that_needs_patience(answer, counts) -> None:
    with scripted(answer(), HASTY) as (radar, far):
        radar.open()
        for command, n in counts.items():
            assert far.commands.count(command) == n or (command == msg.Ping() and n > 0)
        far.send(raw(1))
        assert take(radar, 1)[0].counter == 1


def test_silent_module() -> None:
    with scripted(lambda _: [], Deadlines(reply_s=0.03)) as (radar, far):
        with pytest.raises(DeviceError, match="no answer to a reset"):
            radar.open()
        far.join()
        assert far.commands[:4] == [msg.Reset()] * (1 + RETRIES)
        # The port is given back.
        with pytest.raises(TransportClosed):
            far.near.read(0)


REFUSED = [msg.ErrorReply(ErrorCode.COMMAND_FAILED)]
SAFE = {msg.Ping: [msg.Pong(PongCode.SAFE_MODE)]}
SLOW = Deadlines(ready_s=0.1, ping_every_s=0.02)
MUTE = lambda c: [] if c == msg.Ping() else [msg.Ack()]  # noqa: E731
WHY = [
    (MUTE, SLOW, DeviceError, r"not ready 0\.1 s after"),
    (lambda c: SAFE.get(type(c), [msg.Ack()]), SHORT, errors.SafeModeError, "fail-safe mode"),
    (lambda c: SAFE.get(type(c), REFUSED), SHORT, errors.SafeModeError, "power it off"),
    (obey_but(msg.SetOutput), Deadlines(reply_s=0.3), DeviceError, "no answer to SetOutput"),
    (obey_but(msg.SetOutput, *BUSY), HASTY, DeviceError, r"refused SetOutput.*\(busy\)"),
    (obey_but(msg.SetSysInt, *REFUSED), SHORT, DeviceError, r"0x21 \(command failed\)"),
    (obey_but(msg.SetSysInt, *RESTARTING), SHORT, errors.RestartRequired, r"0x22 \(restarting\)"),
    (obey_but(msg.SetSysInt, msg.ErrorReply(0x77)), SHORT, DeviceError, r"0x77 \(unknown\)"),
    (obey_but(msg.SetSysInt, READY, msg.Ack()), SHORT, DeviceError, "again and again"),
]


@pytest.mark.parametrize(("answer", "deadlines", "error", "words"), WHY)
def test_why_a_module_does_not_start_is_said(answer, deadlines, error, words) -> None:
    with scripted(answer, deadlines) as (radar, _):
        with pytest.raises(error, match=words) as caught:
            radar.open()
        assert type(caught.value) is error


def test_lost_and_late_answers() -> None:
    with scripted(turns(msg.SetSysInt, []), HASTY) as (radar, far):
        radar.open()
        first, second, ping, third = far.commands[2:6]
        assert first == second != third
        assert (ping, far.commands[-1], radar.stats.retries) == (msg.Ping(), START, 1)
    # One that comes too late is not taken for the next ones.
    late = turns(msg.SetSysInt, [], [msg.Ack(), msg.Ack()], [msg.Ack()], REFUSED)
    with scripted(late, HASTY) as (radar, far):
        with pytest.raises(DeviceError, match="refused") as caught:
            radar.open()
        fourth = [c for c in far.commands if isinstance(c, msg.SetSysInt)][3]
        assert SysCfg(fourth.ref).name in str(caught.value)
    # A command that must not be sent twice is not.
    with scripted(obey_but(msg.SetBaudRate), HASTY) as (radar, far):
        radar.open()
        with pytest.raises(DeviceError, match="no answer to SetBaudRate"):
            radar.command(msg.SetBaudRate(921_600))
        assert sum(isinstance(c, msg.SetBaudRate) for c in far.commands) == 1
        assert radar.stats.retries == 0


def test_only_its_own_answer_or_a_refusal_answers_a_command() -> None:
    version, broken = msg.Reply(0x58, 2, "firmware"), framing.encode(b"\x01\x02")
    own = {
        msg.GetSystemInfo(2): [msg.Ack(), msg.Pong(PongCode.READY), FRAME, version],
        msg.GetMode(): [msg.Ack(), msg.Reply(0, 0, (1,))],
        msg.LoadProfile(1): [version, msg.Ack(), msg.ErrorReply(ErrorCode.BUSY)],
        msg.Ping(): [msg.Ack(), msg.Pong(PongCode.NOT_READY)],
    }
    with scripted(lambda command: own[command]) as (radar, far):
        radar.open(stream=False)
        far.send(b"\x02" + broken)
        assert radar.command(msg.GetSystemInfo(2)) == version
        assert radar.command(msg.GetMode()) == msg.Reply(0, 0, (1,))
        assert radar.command(msg.LoadProfile(1)) == msg.Ack()
        assert radar.command(msg.Ping()) == msg.Pong(PongCode.NOT_READY)
        assert radar.stats.damaged == 2
        with pytest.raises(errors.MessageError):
            radar.command(msg.SetMode(300))
        radar.close()
        far.join()
        # Without a stream the module is told nothing else.
        assert far.commands == list(own)


def test_the_late_answer_to_a_ping_counts() -> None:
    pings = []

    def answer(command: msg.Message) -> list[msg.Message]:
        if isinstance(command, msg.Ping):
            pings.append(command)
            if len(pings) == 1:
                threading.Timer(0.06, far.send, [device.wire(msg.Pong(PongCode.READY))]).start()
            return []
        return [msg.Ack()]

    with scripted(answer, replace(SHORT, ping_every_s=0.04)) as (radar, far):
        radar.open()
        assert len(pings) <= 2


def test_a_module_that_streams_meanwhile_is_configured_and_its_old_frames_are_none() -> None:
    data = msg.Data(0, 500, np.zeros(256, np.float32))
    with scripted(lambda c: obey(c) if c == START else [data, *obey(c), data]) as (radar, far):
        radar.open()
        far.send(raw(1))
        (frame,) = take(radar, 1)
        assert (frame.counter, frame.index, frame.restarted) == (1, 0, False)
        assert radar.stats.frames == 1


@pytest.mark.parametrize("answer", [lambda _: [], lambda _: [msg.Ack()]], ids=["reset", "ready"])
def test_closing_from_another_thread_ends_the_opening(answer) -> None:
    with scripted(answer, Deadlines(reply_s=60, ready_s=60)) as (radar, _):
        caught = []

        def opening() -> None:
            with pytest.raises(TransportClosed) as error:
                radar.open()
            caught.append(error)

        thread = device.in_thread(opening)
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
        told = [(f.counter, f.index, f.lost, f.restarted) for f in take(radar, 3)]
        assert told == [(1, 0, 0, False), (3, 2, 1, False), (1, 3, 0, True)]
        names = ("frames", "lost", "repeated", "restarts", "damaged")
        assert [getattr(radar.stats, name) for name in names] == [3, 1, 1, 1, 1]


@pytest.mark.parametrize(
    "said", [(msg.SystemMessage(SystemCode.BOOTING), READY), (READY,)], ids=["both", "ready"]
)
def test_a_module_that_restarts_in_mid_stream_is_told_again_and_its_frames_marked(said) -> None:
    with scripted(deadlines=replace(SHORT, stall_s=60.0)) as (radar, far):
        radar.open()
        frames = iter(radar)
        far.send(raw(1) + raw(2))
        before = [next(frames), next(frames)]
        n_told, start = len(far.commands), far.commands[-1]
        # It streams by itself, with settings that it has not been told yet.
        far.send(device.wire(*said) + raw(3))
        is_told = lambda: start in far.commands[n_told:]  # noqa: E731
        device.in_thread(lambda: (wait_for(is_told), far.send(raw(3))))
        after = next(frames)
        assert msg.Reset() not in far.commands[n_told:]
        assert far.commands[n_told] == msg.SetMode(Mode.IDLE)
        assert (after.index, after.restarted, after.lost) == (2, True, 0)
        far.send(raw(4))
        assert (next(frames).index, radar.stats.restarts) == (3, 1)
    assert [f.restarted for f in before] == [False, False]


def test_what_is_no_stall_and_what_is() -> None:
    with scripted() as (radar, far):
        radar.open()
        far.send(raw(1))
        frames = radar.frames()
        next(frames)
        far.send(raw(2))
        time.sleep(1.5 * SHORT.stall_s)
        assert next(frames).counter == 2
    far = device.FarEnd(obey)
    radar = X2Radar(lambda: far.near, RadarSettings(frame_rate_hz=10), deadlines=SHORT)
    with radar, pytest.raises(ReadTimeout, match=r"no frame for 0\.3 s"):
        next(radar.frames())
    far.close()
