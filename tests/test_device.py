"""X2Radar against simulated modules, over memory and over a pseudo-terminal."""

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

import x2radar
from x2radar import framing
from x2radar.codec import decode_command, encode
from x2radar.device import Deadlines, X2Radar
from x2radar.errors import (
    DeviceError,
    PortNotFound,
    ReadTimeout,
    RestartRequired,
    SafeModeError,
    TransportClosed,
)
from x2radar.frame import Frame
from x2radar.framing import Packet, PacketDecoder
from x2radar.link import RETRIES
from x2radar.messages import (
    Ack,
    Data,
    ErrorReply,
    GetSystemInfo,
    Message,
    Ping,
    Pong,
    Reply,
    Reset,
    SetBaudRate,
    SetMode,
    SetOutput,
    SetSysInt,
    SystemMessage,
)
from x2radar.settings import RadarSettings
from x2radar.sim.faults import FaultPlan
from x2radar.sim.host import serve
from x2radar.sim.module import SimulatedModule
from x2radar.sim.scene import load_scene
from x2radar.transport import PtyTransport, SerialTransport, Transport, memory_pair
from x2radar.wire_ids import ErrorCode, Mode, PongCode, SysCfg, SystemCode

SETTINGS = RadarSettings(frame_stitch=1)
SHORT = Deadlines(
    reply_s=5.0,
    ready_s=5.0,
    ping_every_s=0.03,
    usb_gone_s=0.01,
    stall_s=0.1,
    restart_s=0.01,
    again_s=0.01,
)
HASTY = replace(SHORT, reply_s=0.15, ping_every_s=0.1)
READY = SystemMessage(SystemCode.READY)


def wire(*messages: Message) -> bytes:
    return b"".join(framing.encode(encode(m)) for m in messages)


def module() -> SimulatedModule:
    return SimulatedModule(load_scene("human"), seed=3)


def in_thread(work: Callable[..., object], *args: object, **kwargs: object) -> threading.Thread:
    thread = threading.Thread(target=work, args=args, kwargs=kwargs, daemon=True)
    thread.start()
    return thread


@contextmanager
def simulated(kind: str, speed: float | None = None) -> Iterator[Callable[[], Transport]]:
    """Run a simulated module at the far end; lend what connects to it."""
    if kind == "memory":
        near, far = memory_pair()
        connect: Callable[[], Transport] = lambda: near  # noqa: E731 - the other one is a call
    else:
        far = PtyTransport()
        connect = lambda: SerialTransport(far.path)  # noqa: E731
    thread = in_thread(serve, module(), far, speed=speed)
    try:
        yield connect
    finally:
        far.close()
        thread.join(5)
        assert not thread.is_alive()


class FarEnd:
    """A module whose every answer the test decides.

    Parameters
    ----------
    answer : callable
        Takes a command, returns the messages to send.
    """

    def __init__(self, answer: Callable[[Message], list[Message]]) -> None:
        self.near, self._far = memory_pair()
        self._answer = answer
        self.commands: list[Message] = []
        self._thread = in_thread(self._run)

    def _run(self) -> None:
        decoder = PacketDecoder()
        try:
            while True:
                for item in decoder.feed(self._far.read(1.0)):
                    assert isinstance(item, Packet)
                    self.commands.append(decode_command(item.data))
                    self._far.write(wire(*self._answer(self.commands[-1])))
        except TransportClosed:
            return

    def send(self, data: bytes) -> None:
        self._far.write(data)

    def join(self) -> None:
        """Wait until everything is read that came before the near end closed."""
        self._thread.join(5)
        assert not self._thread.is_alive()

    def close(self) -> None:
        self._far.close()
        self.join()


def obey(command: Message) -> list[Message]:
    """Answer as a module that takes everything."""
    match command:
        case Reset():
            return [Ack(), SystemMessage(SystemCode.BOOTING), READY]
        case Ping():
            return [Pong(PongCode.READY)]
    return [Ack()]


def obey_but(kind: type[Message], *answers: Message) -> Callable[[Message], list[Message]]:
    return lambda command: list(answers) if isinstance(command, kind) else obey(command)


@contextmanager
def scripted(
    answer: Callable[[Message], list[Message]] = obey, deadlines: Deadlines = SHORT
) -> Iterator[tuple[X2Radar, FarEnd]]:
    far = FarEnd(answer)
    radar = X2Radar(lambda: far.near, SETTINGS, deadlines=deadlines)
    yield radar, far
    radar.close()
    far.close()


class Wrapped:
    """A transport with something changed on the way; subclasses say what."""

    is_usb = False

    def __init__(self, inner: Transport) -> None:
        self._inner = inner

    def read(self, timeout_s: float) -> bytes:
        return self._inner.read(timeout_s)

    def write(self, data: bytes) -> None:
        self._inner.write(data)

    def close(self) -> None:
        self._inner.close()


class WithoutReady(Wrapped):
    def read(self, timeout_s: float) -> bytes:
        return super().read(timeout_s).replace(wire(READY), b"")


class OnUsb(Wrapped):
    is_usb = True


def raw(counter: int) -> bytes:
    return wire(Data(0, counter, np.full(256, counter, np.float32)))


def take(radar: X2Radar, n: int) -> list[Frame]:
    return list(itertools.islice(radar.frames(), n))


# ---------------------------------------------------------------- the simulated module


@pytest.mark.parametrize("kind", ["memory", "pty"])
@pytest.mark.parametrize(("output", "dtype"), [("rf", "f4"), ("iq", "c8"), ("ap", "c8")])
def test_first_frames(kind: str, output: str, dtype: str) -> None:
    settings = RadarSettings(frame_stitch=1, output=output, pulse_generator=6)
    with simulated(kind) as connect, X2Radar(connect, settings, name="sim") as radar:
        assert radar.stream is None
        frames = take(radar, 20)
        assert radar.stats.damaged == 0
        assert radar.stream is not None
    assert [f.index for f in frames] == list(range(20))
    assert [f.counter for f in frames] == list(range(1, 21))
    assert all(f.lost == 0 and not f.restarted for f in frames)
    assert {(f.samples.shape, f.samples.dtype) for f in frames} == {((256,), np.dtype(dtype))}
    axis = frames[0].axis
    assert axis.kind == ("rf" if output == "rf" else "baseband")
    assert axis.carrier_hz == pytest.approx(7.3e9)
    assert axis.bin_length_m == pytest.approx(settings.bin_length_m)
    assert radar.stream.axis == axis
    assert (radar.stream.frame_rate_hz, radar.stream.device) == (60.0, "sim")


def test_same_frames_over_memory_and_pty() -> None:
    got = []
    for kind in ("memory", "pty"):
        with simulated(kind) as connect, X2Radar(connect, SETTINGS) as radar:
            got.append(take(radar, 30))
    for one, other in zip(*got, strict=True):
        np.testing.assert_array_equal(one.samples, other.samples)
        assert (one.counter, one.index, one.axis) == (other.counter, other.index, other.axis)


def test_real_time_stream_has_host_times() -> None:
    with simulated("memory", speed=5.0) as connect, X2Radar(connect, SETTINGS) as radar:
        before_s = time.monotonic()
        times_s = [f.t_mono_s for f in take(radar, 30)]
    assert before_s - 1 < times_s[0] <= times_s[-1] <= time.monotonic()
    assert times_s == sorted(times_s)


def test_open_by_port_string() -> None:
    with simulated("pty") as connect:
        path = connect().url
        radar = x2radar.open(path, SETTINGS)
        assert radar.name == f"serial:{path}"
        assert len(take(radar, 3)) == 3
        radar.close()


def test_the_module_answers_further_commands_while_it_streams() -> None:
    with simulated("memory") as connect, X2Radar(connect, SETTINGS) as radar:
        reply = radar.command(GetSystemInfo(2))
        assert isinstance(reply, Reply)
        assert reply.value == "x2radar simulated module"
        with pytest.raises(DeviceError, match=r"LoadProfile.*0x20 \(app invalid\)"):
            radar.command(decode_command(b"\x21\x01\x02\x03\x04"))
        assert len(take(radar, 3)) == 3


def test_the_same_radar_opens_again_after_it_was_closed() -> None:
    with simulated("pty") as connect:
        radar = X2Radar(connect, SETTINGS)
        first = []
        for _ in range(2):
            radar.open()
            first.append(take(radar, 3))
            radar.close()
    for one, other in zip(*first, strict=True):
        assert one.index == other.index
        np.testing.assert_array_equal(one.samples, other.samples)


def test_opening_an_open_radar_starts_afresh() -> None:
    with simulated("pty") as connect:
        radar = X2Radar(connect, SETTINGS)
        radar.open()
        take(radar, 3)
        # The port is locked while it is open, so this needs the first one closed.
        radar.open()
        assert take(radar, 1)[0].index == 0
        radar.close()


# ---------------------------------------------------------------- start-up


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


def test_ready_message_is_enough() -> None:
    with scripted() as (radar, far):
        radar.open()
        assert Ping() not in far.commands


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


def test_module_that_is_not_ready_yet_is_asked_again() -> None:
    codes = itertools.chain([PongCode.NOT_READY] * 2, itertools.repeat(PongCode.READY))

    def answer(command: Message) -> list[Message]:
        if isinstance(command, Ping):
            return [Pong(next(codes))]
        return [Ack()]

    with scripted(answer) as (radar, far):
        radar.open()
        assert far.commands.count(Ping()) >= 3


def test_module_that_never_gets_ready() -> None:
    def answer(command: Message) -> list[Message]:
        return [] if isinstance(command, Ping) else [Ack()]

    short = Deadlines(ready_s=0.1, ping_every_s=0.02)
    with (
        scripted(answer, short) as (radar, _),
        pytest.raises(DeviceError, match=r"not ready 0\.1 s after"),
    ):
        radar.open()


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


def test_module_that_falls_silent_is_named_with_the_command() -> None:
    with (
        scripted(obey_but(SetOutput), Deadlines(reply_s=0.3)) as (radar, _),
        pytest.raises(DeviceError, match="no answer to SetOutput"),
    ):
        radar.open()


@pytest.mark.parametrize(
    ("code", "error", "words"),
    [
        (ErrorCode.COMMAND_FAILED, DeviceError, r"refused SetSysInt.*0x21 \(command failed\)"),
        (ErrorCode.NOT_RECOGNIZED, DeviceError, r"refused SetSysInt.*0x1 \(not recognized\)"),
        (ErrorCode.RESTARTING, RestartRequired, r"refused SetSysInt.*0x22 \(restarting\)"),
        (0x77, DeviceError, r"refused SetSysInt.*0x77 \(unknown\)"),
    ],
)
def test_error_reply_names_the_command(code: int, error: type, words: str) -> None:
    with scripted(obey_but(SetSysInt, ErrorReply(code))) as (radar, _):
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


def test_a_module_that_stays_busy() -> None:
    with (
        scripted(obey_but(SetOutput, ErrorReply(ErrorCode.BUSY)), HASTY) as (radar, _),
        pytest.raises(DeviceError, match=r"refused SetOutput.*\(busy\)"),
    ):
        radar.open()


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


def test_a_refusal_without_safe_mode_stays_a_refusal() -> None:
    answer = obey_but(SetOutput, ErrorReply(ErrorCode.COMMAND_FAILED))
    with scripted(answer) as (radar, far):
        with pytest.raises(DeviceError) as caught:
            radar.open()
        assert type(caught.value) is DeviceError
        assert far.commands[-1] == Ping()


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


def test_a_simulated_module_that_streams_already_is_taken_over() -> None:
    with simulated("pty", speed=1.0) as connect:
        left = X2Radar(connect, SETTINGS)
        left.open()
        take(left, 2)
        # As after a kill: nobody tells the module to stop.
        left._opening.link.close()
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
        thread.join(2)
        assert caught


def test_safe_mode() -> None:
    def answer(command: Message) -> list[Message]:
        return [Pong(PongCode.SAFE_MODE)] if isinstance(command, Ping) else [Ack()]

    with scripted(answer) as (radar, _), pytest.raises(SafeModeError, match="fail-safe mode"):
        radar.open()


def test_data_from_before_the_start_are_no_frames() -> None:
    with scripted() as (radar, far):
        far.send(raw(900) + raw(901))
        radar.open()
        far.send(raw(1))
        (frame,) = take(radar, 1)
    assert (frame.counter, frame.index, frame.restarted) == (1, 0, False)


# ---------------------------------------------------------------- while it streams


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
    with scripted() as (radar, far):
        radar.open()
        frames = iter(radar)
        far.send(raw(1) + raw(2))
        before = [next(frames), next(frames)]
        n_told = len(far.commands)
        # It streams by itself, with settings that it has not been told yet.
        far.send(wire(*said) + raw(3))
        in_thread(lambda: (wait_until(lambda: len(far.commands) > n_told + 10), far.send(raw(3))))
        after = next(frames)
        assert Reset() not in far.commands[n_told:]
        assert far.commands[n_told] == SetMode(Mode.IDLE)
        assert (after.index, after.restarted, after.lost) == (2, True, 0)
        far.send(raw(4))
        assert (next(frames).index, radar.stats.restarts) == (3, 1)
    assert [f.restarted for f in before] == [False, False]


def wait_until(happens: Callable[[], bool]) -> None:
    until_s = time.monotonic() + 5
    while not happens():
        assert time.monotonic() < until_s
        time.sleep(0.002)


def test_a_simulated_module_that_reboots_again_and_again_streams_on() -> None:
    plan = FaultPlan({"reboot": 0.03})
    near, far = memory_pair()
    thread = in_thread(serve, SimulatedModule(load_scene("human"), 3, plan), far, speed=8.0)
    with X2Radar(lambda: near, SETTINGS, deadlines=SHORT) as radar:
        frames = take(radar, 200)
        stats = radar.stats
    far.close()
    thread.join(5)
    indexes = [f.index for f in frames]
    assert indexes == sorted(set(indexes))
    assert stats.restarts >= 2
    assert stats.frames >= 200


def test_stats_are_a_snapshot_over_all_openings() -> None:
    with simulated("pty") as connect:
        radar = X2Radar(connect, SETTINGS)
        for open_it in (radar.open, radar.reopen):
            open_it()
            take(radar, 3)
            stats = radar.stats
            radar.close()
    assert stats.frames >= 6
    assert (stats.lost, stats.damaged, stats.reconnects) == (0, 0, 1)
    with pytest.raises(AttributeError):
        stats.frames = 0


def test_frame_numbers_go_on_when_it_is_opened_again_after_a_loss() -> None:
    with simulated("pty") as connect:
        radar = X2Radar(connect, SETTINGS)
        radar.open()
        last = take(radar, 3)[-1]
        radar.reopen()
        frames = take(radar, 3)
        radar.close()
    assert frames[0].index > last.index
    assert [f.restarted for f in frames] == [True, False, False]
    assert [f.index - frames[0].index for f in frames] == [0, 1, 2]


def test_slow_reader_is_no_stall() -> None:
    with scripted() as (radar, far):
        radar.open()
        far.send(raw(1))
        frames = radar.frames()
        next(frames)
        far.send(raw(2))
        time.sleep(1.5 * SHORT.stall_s)
        assert next(frames).counter == 2


@pytest.mark.parametrize("kind", ["memory", "pty"])
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


# ---------------------------------------------------------------- over USB


class UsbPort:
    """A port that vanishes when its module restarts, and fails some times before it is back."""

    def __init__(self, n_failures: int) -> None:
        self.n_connects = 0
        self._n_failures = n_failures
        self._far: list[Transport] = []

    def connect(self) -> Transport:
        self.n_connects += 1
        if 1 < self.n_connects <= 1 + self._n_failures:
            msg = "gone for a moment"
            raise PortNotFound(msg)
        near, far = memory_pair()
        self._far.append(far)
        in_thread(serve, module(), far, speed=None)
        return OnUsb(near)

    def close(self) -> None:
        for far in self._far:
            far.close()


def test_port_on_usb_is_opened_again_after_the_reset() -> None:
    port = UsbPort(n_failures=2)
    with X2Radar(port.connect, SETTINGS, deadlines=SHORT) as radar:
        assert port.n_connects == 4
        assert [f.index for f in take(radar, 3)] == [0, 1, 2]
    port.close()


def test_port_on_usb_that_does_not_come_back() -> None:
    port = UsbPort(n_failures=1000)
    short = Deadlines(ready_s=0.15, usb_gone_s=0.01)
    radar = X2Radar(port.connect, SETTINGS, deadlines=short)
    with pytest.raises(PortNotFound):
        radar.open()
    assert port.n_connects > 2
    port.close()


class GoneAfterReset(OnUsb):
    """A port that vanishes before the reset's answer is through, and once more, late."""

    def __init__(self, inner: Transport, n_reads: int) -> None:
        super().__init__(inner)
        self._n_reads = n_reads

    def read(self, timeout_s: float) -> bytes:
        self._n_reads -= 1
        if self._n_reads == 0:
            msg = "gone"
            raise TransportClosed(msg)
        return super().read(timeout_s)


def test_port_on_usb_that_vanishes_early_and_late() -> None:
    port = UsbPort(n_failures=0)

    def connect() -> Transport:
        inner = port.connect()
        return GoneAfterReset(inner, 1) if port.n_connects < 3 else inner

    with X2Radar(connect, SETTINGS, deadlines=SHORT) as radar:
        assert port.n_connects == 3
        assert [f.index for f in take(radar, 3)] == [0, 1, 2]
    port.close()
