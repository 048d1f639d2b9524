import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim_helpers import axis_of
from x2radar import framing
from x2radar.codec import decode_response, encode
from x2radar.framing import PacketDecoder, Packing
from x2radar.messages import (
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
from x2radar.settings import RadarSettings
from x2radar.sim.module import BOOT_S, LATEST_S, RESET_DELAY_S, EchoStream, SimulatedModule
from x2radar.sim.pulse import LinkBudget, rf_echo
from x2radar.sim.scene import load_scene, parse_scene
from x2radar.wire_ids import (
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

HUMAN, EMPTY = load_scene("human"), load_scene("empty")
MANUAL = SetMode(Mode.MANUAL)
REFUSED = ErrorReply(ErrorCode.COMMAND_FAILED)
UNKNOWN = ErrorReply(ErrorCode.NOT_RECOGNIZED)


def module(scene=HUMAN, seed=0):
    return SimulatedModule(scene, seed)


def said(m):
    """What the module has said since it was last asked, as messages."""
    decoder = PacketDecoder()
    out = [decode_response(packet.data) for packet in decoder.feed(m.data_to_send())]
    assert decoder.n_buffered == 0
    return out


def ask(m, *commands):
    """Send commands; return everything that came back."""
    for command in commands:
        m.receive(framing.encode(encode(command)))
    return said(m)


def fps(rate_hz):
    return SetSysInt(SysCfg.FPS, rate_hz)


def frames(m, n):
    """Start the stream if it does not run, and return the next `n` frame messages."""
    if not m.is_streaming:
        assert ask(m, MANUAL) == [Ack()]
    out = []
    while len(out) < n:
        m.advance(m.next_due_s)
        out += said(m)
    return out[:n]


# ---------------------------------------------------------------- commands


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
        (SetOutput(OutputRef.BASEBAND, BasebandOutput.PHASE), UNKNOWN),
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


@pytest.mark.parametrize("item", [i for i in InfoItem if i not in {5, 7, 8, 9}])
def test_info_items_are_text(item):
    [reply] = ask(module(), GetSystemInfo(item))
    assert isinstance(reply, Reply)
    assert reply.info == item
    assert reply.value


@pytest.mark.parametrize("packing", list(Packing))
def test_any_packing_is_understood(packing):
    m = module()
    m.receive(framing.encode(encode(Ping()), packing))
    m.receive(framing.encode(encode(Ping())))
    assert said(m) == [Pong(PongCode.READY)] * 2


def test_commands_in_pieces_and_together():
    m = module()
    line = b"".join(framing.encode(encode(c)) for c in (Ping(), SetLed(1), fps(30)))
    for byte in line:
        m.receive(bytes([byte]))
    assert said(m) == [Pong(PongCode.READY), Ack(), Ack()]
    m.receive(line)
    assert said(m) == [Pong(PongCode.READY), Ack(), Ack()]


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


def test_reset_in_one_leap_of_time():
    m = module()
    ask(m, Reset())
    m.advance(60.0)
    assert said(m) == [SystemMessage(SystemCode.BOOTING), SystemMessage(SystemCode.READY)]


def test_it_still_answers_between_reset_and_restart():
    m = module()
    assert ask(m, Reset(), Ping()) == [Ack(), Pong(PongCode.READY)]


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


# ---------------------------------------------------------------- stream


def test_frames_come_only_in_manual_mode():
    m = module()
    m.advance(5.0)
    assert said(m) == []
    assert not m.is_streaming
    for mode in (Mode.RUN, Mode.NORMAL, Mode.IDLE, Mode.STOP):
        assert ask(m, MANUAL) == [Ack()]
        assert m.is_streaming
        m.advance(m.next_due_s)
        assert len(said(m)) == 1
        assert ask(m, SetMode(mode)) == [Ack()]
        assert not m.is_streaming
        assert m.next_due_s == math.inf
        m.advance(5.0)
        assert said(m) == []


def test_an_unknown_mode_changes_nothing():
    m = module()
    frames(m, 2)
    assert ask(m, SetMode(0x77)) == [REFUSED]
    assert m.is_streaming
    assert frames(m, 1)[0].info == 3


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


def test_starting_again_starts_the_scene_and_the_counter_again():
    m = module()
    first = frames(m, 20)
    assert ask(m, SetMode(Mode.IDLE)) == [Ack()]
    again = frames(m, 20)
    assert [f.info for f in again] == list(range(1, 21))
    for a, b in zip(first, again, strict=True):
        assert np.array_equal(a.values, b.values)


def output(value):
    return SetOutput(OutputRef.BASEBAND, value)


@pytest.mark.parametrize("kind", list(BasebandOutput)[:3])
def test_same_seed_same_bytes(kind):
    def bytes_of(seed):
        m = module(HUMAN, seed)
        ask(m, output(kind), MANUAL)
        m.advance(0.5)
        return m.data_to_send()

    assert bytes_of(5) == bytes_of(5)
    assert bytes_of(5) != bytes_of(6)
    assert len(bytes_of(5)) > 31 * 768 * 4


def test_frames_do_not_depend_on_when_the_host_looks():
    a, b = module(), module()
    for m in (a, b):
        ask(m, MANUAL)
    a.advance(0.9)
    for t in [*np.arange(0, 0.9, 0.01).tolist(), 0.9]:
        b.advance(t)
    assert a.data_to_send() == b.data_to_send()


def test_rf_frames():
    m = module()
    for k, message in enumerate(frames(m, 3)):
        assert isinstance(message, Data)
        assert (message.content_id, message.info) == (0, k + 1)
        assert message.values.shape == (768,)
        assert message.values.dtype == np.float32
        assert 0 <= message.values.min() < message.values.max() < 100
        assert message.values.mean() == pytest.approx(50, abs=0.5)


def test_rf_frames_are_static_clutter_body_and_noise():
    """Frame by frame against the parts of the simulator."""
    scene = parse_scene(
        "steps: [{duration_s: 60}]\nclutter: [{range_m: 2, rcs_m2: 4.0e+4}]", "wall", "wall"
    )
    stream = EchoStream(scene, 0, RadarSettings())
    axis = axis_of("rf")
    wall = np.array([[2.0]])
    clean = rf_echo(wall, LinkBudget().amplitude(wall, np.array([4e4]), axis), axis)[0]
    mean = np.mean([stream.next() for _ in range(400)], axis=0)
    assert np.abs(mean - 50 - clean).max() < 5.5 * 0.04 / math.sqrt(400)
    assert np.abs(clean).max() > 1


@pytest.mark.parametrize(
    ("kind", "cls"),
    [(BasebandOutput.IQ, BasebandIq), (BasebandOutput.AMPLITUDE_PHASE, BasebandAp)],
)
def test_baseband_frames_carry_their_axis(kind, cls):
    s = RadarSettings()
    m = module()
    ask(m, output(kind))
    for k, message in enumerate(frames(m, 3)):
        assert isinstance(message, cls)
        assert message.counter == k + 1
        assert message.bin_length_m == pytest.approx(s.bin_length_m, rel=1e-6)
        assert message.range_offset_m == pytest.approx(s.range_offset_m, rel=1e-6)
        assert message.carrier_hz == pytest.approx(6.8e9, rel=1e-6)
        assert message.sample_rate_hz == pytest.approx(41e9, rel=1e-6)


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
        SetSysInt(SysCfg.PG_SELECT, 12),
        SetSysInt(SysCfg.DAC_MIN, 8191),
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
    assert not m.is_streaming
    m.advance(1.0)
    assert said(m) == []
    ask(m, Reset())
    m.advance(2.0)
    said(m)
    assert ask(m, MANUAL) == [Ack()]


@pytest.mark.parametrize(
    "command",
    [
        fps(0),
        fps(-5),
        fps(1),
        output(BasebandOutput.IQ),
        output(BasebandOutput.AMPLITUDE_PHASE),
        SetSysInt(SysCfg.FRAME_STITCH, 1),
    ],
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
    assert m.n_skipped == pytest.approx((5 - LATEST_S) * 60, abs=1)
    assert received[0].info == m.n_skipped + 1
    assert [f.info for f in received] == list(range(m.n_skipped + 1, 302))
    m.advance(m.next_due_s)
    assert [f.info for f in said(m)] == [302]


def test_a_host_within_the_limit_loses_nothing():
    m = module(EMPTY)
    ask(m, MANUAL)
    m.advance(LATEST_S)
    assert len(said(m)) == 121
    assert m.n_skipped == 0


def test_lost_frames_are_the_scenes_too():
    """What comes after a gap is what a host that lost nothing has at that count."""
    late, prompt = module(), module()
    for m in (late, prompt):
        ask(m, MANUAL)
    late.advance(4.0)
    for t in np.linspace(0, 4, 9).tolist():
        prompt.advance(t)
    ours = said(late)
    by_count = {f.info: f.values for f in said(prompt)}
    assert len(by_count) == 241
    assert late.n_skipped > 0
    for f in ours:
        assert np.array_equal(f.values, by_count[f.info])


def test_time_never_goes_back():
    m = module(EMPTY)
    ask(m, MANUAL)
    m.advance(0.1)
    said(m)
    m.advance(0.0)
    assert said(m) == []
    assert m.next_due_s > 0.1


def test_counter_wraps():
    m = module(EMPTY)
    frames(m, 1)
    m._counter = 0xFFFFFFFE  # 2.3 years of frames later
    assert [f.info for f in frames(m, 3)] == [0xFFFFFFFF, 0, 1]
