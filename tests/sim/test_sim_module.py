"""The simulated module's answers: commands, and what a reset does."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.framing_helpers import Packing
from tests.framing_helpers import encode as packed
from tests.module_helpers import EMPTY, MANUAL, REFUSED, UNKNOWN, ask, fps, frames, module, said
from x2radar.sim.module.module import BOOT_S, RESET_DELAY_S
from x2radar.wire import framing
from x2radar.wire.codec import encode
from x2radar.wire.messages import (
    Ack,
    BasebandAp,
    BasebandIq,
    Data,
    ErrorReply,
    GetMode,
    GetSystemInfo,
    LoadProfile,
    Ping,
    Pong,
    Reply,
    Reset,
    SetBaudRate,
    SetDetectionZone,
    SetLed,
    SetMode,
    SetOutput,
    SetSensitivity,
    SetSysFloat,
    SetSysInt,
    SystemMessage,
    Unknown,
)
from x2radar.wire.wire_ids import (
    BasebandOutput,
    ErrorCode,
    InfoItem,
    Mode,
    OutputRef,
    PongCode,
    Profile,
    SysCfg,
    SystemCode,
)


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (Ping(), Pong(PongCode.READY)),
        (Reset(), Ack()),
        (SetMode(Mode.RUN), Ack()),
        (SetMode(Mode.NORMAL), Ack()),
        (SetMode(Mode.IDLE), Ack()),
        (SetMode(Mode.STOP), Ack()),
        (MANUAL, Ack()),
        (LoadProfile(Profile.RESPIRATION), Ack()),
        (LoadProfile(Profile.PRESENCE_3), Ack()),
        (SetLed(2), Ack()),
        (SetDetectionZone(0.5, 2.5), Ack()),
        (SetSensitivity(5), Ack()),
        (SetBaudRate(921_600), Ack()),
        (SetOutput(OutputRef.BASEBAND, BasebandOutput.IQ), Ack()),
        (SetSysInt(SysCfg.DAC_STEP, 2), Ack()),
        (SetSysInt(SysCfg.MCLK_DIV, 2), Ack()),
        (SetSysFloat(SysCfg.SAMPLE_DELAY, 5e-9), Ack()),
        (GetSystemInfo(InfoItem.ITEM_NUMBER), Reply(0x58, 0, "SIM")),
        (GetSystemInfo(InfoItem.SERIAL_NUMBER), Reply(0x58, 6, "000000000000")),
        # Refused:
        (Ping(0x12345678), UNKNOWN),
        (GetMode(), UNKNOWN),
        (GetSystemInfo(99), UNKNOWN),
        (LoadProfile(0xDEADBEEF), ErrorReply(ErrorCode.APP_INVALID)),
        (SetMode(0x99), REFUSED),
        (SetSysInt(0x99, 1), REFUSED),
        (SetSysFloat(0x99, 1.0), REFUSED),
        (SetSysFloat(SysCfg.FPS, math.nan), REFUSED),
        (SetSysFloat(SysCfg.DAC_STEP, math.inf), REFUSED),
        (SetSysFloat(SysCfg.ITERATIONS, -math.inf), REFUSED),
        (SetOutput(OutputRef.BASEBAND, 77), UNKNOWN),
        (SetOutput(OutputRef.PULSE_DOPPLER, 1), UNKNOWN),
        (Unknown(b"\x99\x01"), UNKNOWN),
        (Unknown(b"\x20"), UNKNOWN),  # set mode without its mode
        (Unknown(b"\x20\x12\x12"), UNKNOWN),
        (Unknown(b"\x90\x71\x10"), UNKNOWN),
        (Unknown(b"\x90\x51\x1a\x00\x00\x00"), UNKNOWN),
    ],
)
def test_answers(command, answer):
    m = module()
    assert ask(m, command) == [answer]
    assert ask(m, Ping()) == [Pong(PongCode.READY)]  # and it goes on obeying


@pytest.mark.parametrize("packing", list(Packing))
def test_any_packing_is_understood(packing):
    m = module()
    m.receive(packed(encode(Ping()), packing))
    m.receive(framing.encode(encode(Ping())))
    assert said(m) == [Pong(PongCode.READY)] * 2


def test_damaged_packets_get_no_answer():
    ping = framing.encode(encode(Ping()))
    for k in range(1, len(ping) - 1):
        m = module()
        m.receive(ping[:k] + bytes([ping[k] ^ 0x01]) + ping[k + 1 :])
        assert said(m) == []
        assert ask(m, Ping()) == [Pong(PongCode.READY)]
    m = module()
    m.receive(b"junk" + ping + b"\x00\xff")
    assert said(m) == [Pong(PongCode.READY)]


@given(st.lists(st.binary(min_size=1, max_size=40), max_size=6))
def test_every_sound_packet_gets_one_answer(packets):
    m = module(EMPTY)
    for data in packets:
        if data[0] == framing.FAST or data[:2] == b"\x20\x12":
            continue
        m.receive(framing.encode(data))
        assert len(said(m)) == 1


@given(st.binary(max_size=300))
def test_any_bytes_are_survived(data):
    m = module(EMPTY)
    m.receive(data)
    m.advance(0.2)
    said(m)


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("int"), st.sampled_from(SysCfg), st.integers(-(2**31), 2**31 - 1)),
            st.tuples(st.just("float"), st.sampled_from(SysCfg), st.floats(width=32)),
            st.tuples(st.just("mode"), st.sampled_from(Mode), st.just(0)),
            st.tuples(st.just("output"), st.integers(0, 5), st.just(0)),
        ),
        max_size=12,
    )
)
def test_any_settings_and_modes_are_survived(steps):
    m = module(EMPTY)
    now_s = 0.0
    for what, ref, value in steps:
        match what:
            case "int":
                answers = ask(m, SetSysInt(ref, value))
            case "float":
                answers = ask(m, SetSysFloat(ref, value))
            case "mode":
                answers = ask(m, SetMode(ref))
            case _:
                answers = ask(m, SetOutput(OutputRef.BASEBAND, ref))
        assert len(answers) == 1
        now_s += 0.004
        m.advance(now_s)
        for message in said(m):
            assert isinstance(message, (Data, BasebandIq, BasebandAp))


# ---------------------------------------------------------------- reset


def test_reset_boots_and_becomes_ready():
    m = module()
    m.advance(10.0)
    assert ask(m, Reset()) == [Ack()]
    assert m.next_due_s == pytest.approx(10 + RESET_DELAY_S)
    m.advance(m.next_due_s)
    assert said(m) == [SystemMessage(SystemCode.BOOTING)]
    assert ask(m, Ping(), MANUAL, Reset()) == []  # nobody is at home
    assert m.next_due_s == pytest.approx(10 + RESET_DELAY_S + BOOT_S)
    m.advance(m.next_due_s)
    assert said(m) == [SystemMessage(SystemCode.READY)]
    assert m.next_due_s == math.inf
    assert ask(m, Ping()) == [Pong(PongCode.READY)]


def test_reset_forgets_settings_and_stops_the_stream():
    m = module()
    ask(m, fps(30), SetOutput(OutputRef.BASEBAND, BasebandOutput.IQ))
    assert isinstance(frames(m, 3)[0], BasebandIq)
    ask(m, Reset())
    m.advance(1.0)
    assert not m.is_streaming
    messages = said(m)
    assert messages[-2:] == [SystemMessage(SystemCode.BOOTING), SystemMessage(SystemCode.READY)]
    m.advance(2.0)
    assert said(m) == []
    first = frames(m, 1)[0]
    assert isinstance(first, Data)
    assert first.info == 1
    assert m.next_due_s == pytest.approx(2.0 + 1 / 60)
