"""The simulated module: its answers, what a reset does, and its frames."""

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.device_helpers import served, wire
from tests.echo_references import passband
from tests.sim_helpers import (
    EMPTY,
    MANUAL,
    REFUSED,
    UNKNOWN,
    ask,
    axis_of,
    fps,
    frames,
    module,
    said,
)
from x2radar.device.transport import memory_pair
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.module.module import BOOT_S, MAX_LATE_S, RESET_DELAY_S, EchoStream
from x2radar.sim.scene.scene import parse_scene
from x2radar.sim.signal.pulse import LinkBudget
from x2radar.wire import framing
from x2radar.wire import messages as msg
from x2radar.wire import wire_ids as ids
from x2radar.wire.codec import decode_response
from x2radar.wire.framing import PacketDecoder
from x2radar.wire.messages import Ack, Reset, SetMode, SetOutput, SetSysFloat, SetSysInt
from x2radar.wire.wire_ids import BasebandOutput, Mode, OutputRef, SysCfg


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


def test_frames_come_only_in_manual_mode():
    m = module()
    m.advance(5.0)
    assert said(m) == []
    for mode in (Mode.RUN, Mode.NORMAL, Mode.IDLE, Mode.STOP):
        assert ask(m, MANUAL) == [Ack()]
        m.advance(m.next_due_s)
        assert len(said(m)) == 1
        assert ask(m, SetMode(mode)) == [Ack()]
        assert m.next_due_s == math.inf
        m.advance(5.0)
        assert said(m) == []


@pytest.mark.parametrize("rate_hz", [1, 60, 200])
def test_frames_come_at_their_rate_and_count_from_one(rate_hz):
    m = module(EMPTY)
    m.advance(3.0)
    # One iteration fits every rate.
    assert ask(m, SetSysInt(SysCfg.ITERATIONS, 1), fps(rate_hz), MANUAL) == [Ack()] * 3
    counters, times = [], []
    for _ in range(40):
        times.append(m.next_due_s)
        m.advance(m.next_due_s)
        [frame] = said(m)
        counters.append(frame.info)
    assert counters == list(range(1, 41))
    assert times == pytest.approx(3.0 + np.arange(40) / rate_hz)


def output(value):
    return SetOutput(OutputRef.BASEBAND, value)


def test_rf_frames_are_static_clutter_body_and_noise():
    """Frame by frame against the parts of the simulator."""
    scene = parse_scene(
        "steps: [{duration_s: 60}]\nclutter: [{range_m: 2, rcs_m2: 4.0e+4}]", "wall", "wall"
    )
    stream = EchoStream(scene, 0, RadarSettings())
    axis = axis_of("rf")
    wall = np.array([[2.0]])
    clean = passband(wall, LinkBudget().amplitude(wall, np.array([4e4]), axis), axis)[0]
    mean = np.mean([stream.next() for _ in range(400)], axis=0)
    assert np.abs(mean - 50 - clean).max() < 5.5 * 0.04 / math.sqrt(400)
    assert np.abs(clean).max() > 1


def test_iq_and_ap_are_the_same_frames():
    iq, ap = module(), module()
    ask(iq, output(BasebandOutput.IQ))
    ask(ap, output(BasebandOutput.AMPLITUDE_PHASE))
    for a, b in zip(frames(iq, 5), frames(ap, 5), strict=True):
        whole = a.i + 1j * a.q
        error = np.abs(whole - b.amplitude * np.exp(1j * b.phase)).max()
        assert error < 1e-6 * b.amplitude.max()
        assert b.amplitude.min() >= 0


def test_settings_reach_the_frames():
    m = module()
    for ref, value in (
        (SysCfg.FRAME_STITCH, 2),
        (SysCfg.PG_SELECT, 11),
        (SysCfg.DAC_MIN, 4000),
        (SysCfg.DAC_MAX, 4191),
    ):
        assert ask(m, SetSysInt(ref, value)) == [Ack()]
    assert ask(m, SetSysFloat(SysCfg.SAMPLE_DELAY, 8e-9)) == [Ack()]
    first = frames(m, 1)[0]
    assert first.values.size == 512
    assert first.values.min() >= np.float32(100 * 4000 / 8192)
    assert first.values.max() <= np.float32(100 * 4191 / 8192)
    ask(m, SetMode(Mode.IDLE), output(BasebandOutput.IQ))
    first = frames(m, 1)[0]
    assert first.carrier_hz == pytest.approx(9.1e9, rel=1e-6)
    assert first.range_offset_m == pytest.approx(299_792_458.0 * 4e-9, rel=1e-6)


@pytest.mark.parametrize(
    "command",
    [
        fps(0),
        fps(-60),
        fps(1001),
        SetSysInt(SysCfg.FRAME_STITCH, 6),
        SetSysInt(SysCfg.ITERATIONS, 2**31 - 1),
        SetSysInt(SysCfg.ITERATIONS, 200),  # takes longer than a frame
        SetSysFloat(SysCfg.SAMPLE_DELAY, 1.0),
        SetSysFloat(SysCfg.DAC_STEP, 3e38),
        SetSysFloat(SysCfg.FPS, 60.5),
    ],
)
def test_impossible_settings_are_refused_when_the_stream_should_start(command):
    m = module()
    assert ask(m, command) == [Ack()]
    assert ask(m, MANUAL) == [REFUSED]
    m.advance(1.0)
    assert said(m) == []
    ask(m, Reset())
    m.advance(2.0)
    said(m)
    assert ask(m, MANUAL) == [Ack()]


@pytest.mark.parametrize(
    "command", [fps(0), fps(1), output(BasebandOutput.IQ), SetSysInt(SysCfg.FRAME_STITCH, 1)]
)
def test_what_changes_while_the_stream_runs_does_not_touch_it(command):
    m = module(EMPTY)
    before = frames(m, 2)
    assert ask(m, command) == [Ack()]
    at_s = m.next_due_s
    after = frames(m, 3)
    assert [f.info for f in before + after] == [1, 2, 3, 4, 5]
    assert all(f.values.size == 768 for f in after)
    assert m.next_due_s - at_s == pytest.approx(3 / 60)


def test_a_late_host_loses_frames_and_the_counter_goes_on():
    m = module(EMPTY)
    ask(m, MANUAL)
    m.advance(5.0)  # frames were due at 0, 1/60 ... 5
    received = said(m)
    assert len(received) + m.n_skipped == 301
    assert m.n_skipped == pytest.approx((5 - MAX_LATE_S) * 60, abs=1)
    assert received[0].info == m.n_skipped + 1
    assert [f.info for f in received] == list(range(m.n_skipped + 1, 302))
    m.advance(m.next_due_s)
    assert [f.info for f in said(m)] == [302]


@pytest.mark.parametrize("speed", [50.0, 1e5, None])
def test_faster_than_time_it_waits_for_a_reader_who_is_late(speed):
    """Before, a factor that the computer cannot keep up with lost frames, and so decisions."""
    m = module(EMPTY)
    near, far = memory_pair(capacity=1)
    with served(far, m, speed):
        near.write(wire(MANUAL))
        time.sleep(0.2)  # at 50 times real time ten seconds: five times what a late host may be
        decoder, received = PacketDecoder(), []
        while len(received) < 151:
            received += [decode_response(p.data) for p in decoder.feed(near.read(10.0))]
    assert m.n_skipped == 0
    assert [frame.info for frame in received[1:]] == list(range(1, len(received)))
