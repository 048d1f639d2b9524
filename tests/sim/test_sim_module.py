"""The simulated module's answers: commands, and what a reset does."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim_helpers import EMPTY, MANUAL, REFUSED, UNKNOWN, ask, fps, frames, module, said
from x2radar.sim.module.module import BOOT_S, RESET_DELAY_S
from x2radar.wire import framing
from x2radar.wire import messages as msg
from x2radar.wire import wire_ids as ids


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (msg.Ping(), msg.Pong(ids.PongCode.READY)),
        (msg.Reset(), msg.Ack()),
        (msg.SetMode(ids.Mode.RUN), msg.Ack()),
        (msg.SetMode(ids.Mode.IDLE), msg.Ack()),
        (msg.SetMode(ids.Mode.STOP), msg.Ack()),
        (MANUAL, msg.Ack()),
        (msg.LoadProfile(ids.Profile.RESPIRATION), msg.Ack()),
        (msg.SetLed(2), msg.Ack()),
        (msg.SetDetectionZone(0.5, 2.5), msg.Ack()),
        (msg.SetSensitivity(5), msg.Ack()),
        (msg.SetBaudRate(921_600), msg.Ack()),
        (msg.SetOutput(ids.OutputRef.BASEBAND, ids.BasebandOutput.IQ), msg.Ack()),
        (msg.SetSysInt(ids.SysCfg.DAC_STEP, 2), msg.Ack()),
        (msg.SetSysFloat(ids.SysCfg.SAMPLE_DELAY, 5e-9), msg.Ack()),
        (msg.GetSystemInfo(ids.InfoItem.ITEM_NUMBER), msg.Reply(0x58, 0, "SIM")),
        (msg.GetSystemInfo(ids.InfoItem.SERIAL_NUMBER), msg.Reply(0x58, 6, "000000000000")),
        # Refused:
        (msg.Ping(0x12345678), UNKNOWN),
        (msg.GetMode(), UNKNOWN),
        (msg.GetSystemInfo(99), UNKNOWN),
        (msg.LoadProfile(0xDEADBEEF), msg.ErrorReply(ids.ErrorCode.APP_INVALID)),
        (msg.SetMode(0x99), REFUSED),
        (msg.SetSysInt(0x99, 1), REFUSED),
        (msg.SetSysFloat(0x99, 1.0), REFUSED),
        (msg.SetSysFloat(ids.SysCfg.FPS, math.nan), REFUSED),
        (msg.SetSysFloat(ids.SysCfg.ITERATIONS, -math.inf), REFUSED),
        (msg.SetOutput(ids.OutputRef.BASEBAND, 77), UNKNOWN),
        (msg.SetOutput(ids.OutputRef.PULSE_DOPPLER, 1), UNKNOWN),
        (msg.Unknown(b"\x99\x01"), UNKNOWN),
        (msg.Unknown(b"\x20"), UNKNOWN),  # set mode without its mode
        (msg.Unknown(b"\x90\x71\x10"), UNKNOWN),
        (msg.Unknown(b"\x90\x51\x1a\x00\x00\x00"), UNKNOWN),
    ],
)
def test_answers(command, answer):
    m = module()
    assert ask(m, command) == [answer]
    assert ask(m, msg.Ping()) == [msg.Pong(ids.PongCode.READY)]  # and it goes on obeying


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


STEPS = st.one_of(
    st.builds(msg.SetSysInt, st.sampled_from(ids.SysCfg), st.integers(-(2**31), 2**31 - 1)),
    st.builds(msg.SetSysFloat, st.sampled_from(ids.SysCfg), st.floats(width=32)),
    st.builds(msg.SetMode, st.sampled_from(ids.Mode)),
    st.builds(msg.SetOutput, st.just(ids.OutputRef.BASEBAND), st.integers(0, 5)),
)


@given(st.lists(STEPS, max_size=12))
def test_any_settings_and_modes_are_survived(commands):
    m, kinds = module(EMPTY), (msg.Data, msg.BasebandIq, msg.BasebandAp)
    for k, command in enumerate(commands):
        assert len(ask(m, command)) == 1
        m.advance(0.004 * (k + 1))
        assert all(isinstance(message, kinds) for message in said(m))


def test_reset_boots_and_forgets_settings_and_stream():
    m = module()
    m.advance(10.0)
    ask(m, fps(30), msg.SetOutput(ids.OutputRef.BASEBAND, ids.BasebandOutput.IQ))
    assert isinstance(frames(m, 1)[0], msg.BasebandIq)
    assert ask(m, msg.Reset()) == [msg.Ack()]
    m.advance(10 + RESET_DELAY_S - 1e-6)
    assert all(isinstance(message, msg.BasebandIq) for message in said(m))
    m.advance(10 + RESET_DELAY_S)
    assert said(m) == [msg.SystemMessage(ids.SystemCode.BOOTING)]
    assert ask(m, msg.Ping(), MANUAL, msg.Reset()) == []  # nobody is at home
    assert m.next_due_s == pytest.approx(10 + RESET_DELAY_S + BOOT_S)
    m.advance(m.next_due_s)
    assert said(m) == [msg.SystemMessage(ids.SystemCode.READY)]
    assert m.next_due_s == math.inf
    assert ask(m, msg.Ping()) == [msg.Pong(ids.PongCode.READY)]
    now_s = 10 + RESET_DELAY_S + BOOT_S
    (first,) = frames(m, 1)
    assert isinstance(first, msg.Data)
    assert first.info == 1
    assert m.next_due_s == pytest.approx(now_s + 1 / 60)
