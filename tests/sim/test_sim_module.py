"""The simulated module: its answers, its frames, and other modules through the same driver."""

import math
import time
from dataclasses import asdict
from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests import sim_helpers
from tests.device_helpers import plugged, served, wire
from tests.echo_references import passband
from tests.sim_helpers import EMPTY, MANUAL, REFUSED, UNKNOWN, ask, fps, frames, module, said
from x2radar.device.device import X2Radar
from x2radar.device.transport import memory_pair
from x2radar.errors import DeviceError, SettingsError
from x2radar.modules.modules import MODULES, ModuleRow, module_for
from x2radar.modules.profile import ProfileSettings
from x2radar.modules.x2 import RadarSettings
from x2radar.modules.x4 import X4Settings
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.recording.capture import CaptureWriter, CapturingTransport
from x2radar.recording.registry import open_recording
from x2radar.sim.module.firmware import FIRMWARES, X2Firmware, X4Firmware
from x2radar.sim.module.host import connect
from x2radar.sim.module.module import BOOT_S, MAX_LATE_S, RESET_DELAY_S, SimulatedModule
from x2radar.sim.module.stream import EchoStream
from x2radar.sim.scene.scene import load_scene, parse_scene
from x2radar.sim.signal.pulse import LinkBudget
from x2radar.wire import framing
from x2radar.wire import messages as msg
from x2radar.wire import wire_ids as ids
from x2radar.wire.codec import decode_response
from x2radar.wire.framing import PacketDecoder
from x2radar.wire.messages import Ack, Reset, SetMode, SetOutput, SetSysFloat, SetSysInt
from x2radar.wire.wire_ids import BasebandOutput, Mode, OutputRef, SysCfg

OBEYED = [msg.Reset(), MANUAL, *map(msg.SetMode, (Mode.RUN, Mode.IDLE, Mode.STOP)), msg.SetLed(2)]
OBEYED += [msg.LoadProfile(ids.Profile.RESPIRATION), msg.SetDetectionZone(0.5, 2.5)]
OBEYED += [msg.SetSensitivity(5), msg.SetBaudRate(921_600), SetSysInt(SysCfg.DAC_STEP, 2)]
OBEYED += [SetSysFloat(SysCfg.SAMPLE_DELAY, 5e-9)]
OBEYED += [SetOutput(OutputRef.BASEBAND, BasebandOutput.IQ)]
FAILED = [SetMode(0x99), SetSysInt(0x99, 1), SetSysFloat(0x99, 1.0)]
FAILED += [SetSysFloat(SysCfg.FPS, math.nan), SetSysFloat(SysCfg.ITERATIONS, -math.inf)]
STRANGE = [msg.Ping(0x12345678), msg.GetMode(), msg.GetSystemInfo(99)]
STRANGE += [SetOutput(OutputRef.BASEBAND, 77), SetOutput(OutputRef.PULSE_DOPPLER, 1)]
# The last is to set a mode without its mode.
CUT_OFF = (b"\x99\x01", b"\x90\x71\x10", b"\x90\x51\x1a\x00\x00\x00", b"\x20")


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (msg.Ping(), msg.Pong(ids.PongCode.READY)),
        (msg.GetSystemInfo(ids.InfoItem.ITEM_NUMBER), msg.Reply(0x58, 0, "SIM")),
        (msg.GetSystemInfo(ids.InfoItem.SERIAL_NUMBER), msg.Reply(0x58, 6, "000000000000")),
        (msg.LoadProfile(0xDEADBEEF), msg.ErrorReply(ids.ErrorCode.APP_INVALID)),
        *((command, Ack()) for command in OBEYED),
        *((command, REFUSED) for command in FAILED),
        *((command, UNKNOWN) for command in (*STRANGE, *map(msg.Unknown, CUT_OFF))),
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
    text = "steps: [{duration_s: 60}]\nclutter: [{range_m: 2, rcs_m2: 4.0e+4}]"
    stream = EchoStream(parse_scene(text, "wall", "wall"), 0, RadarSettings())
    axis = sim_helpers.axis_of("rf")
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
        assert np.abs(whole - b.amplitude * np.exp(1j * b.phase)).max() < 1e-6 * b.amplitude.max()
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


# The last takes longer than a frame.
IMPOSSIBLE = [fps(0), fps(-60), fps(1001), SetSysInt(SysCfg.FRAME_STITCH, 6)]
IMPOSSIBLE += [SetSysFloat(SysCfg.SAMPLE_DELAY, 1.0), SetSysFloat(SysCfg.DAC_STEP, 3e38)]
IMPOSSIBLE += [SetSysFloat(SysCfg.FPS, 60.5)]
IMPOSSIBLE += [SetSysInt(SysCfg.ITERATIONS, n) for n in (2**31 - 1, 200)]


@pytest.mark.parametrize("command", IMPOSSIBLE)
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
    n_skipped = received[0].info - 1
    assert len(received) + n_skipped == 301
    assert n_skipped == pytest.approx((5 - MAX_LATE_S) * 60, abs=1)
    assert [f.info for f in received] == list(range(n_skipped + 1, 302))
    m.advance(m.next_due_s)
    assert [f.info for f in said(m)] == [302]


@pytest.mark.parametrize("speed", [50.0, 1e5, None])
def test_faster_than_time_it_waits_for_a_reader_who_is_late(speed):
    """Before, a factor that the computer cannot keep up with lost frames, and so decisions."""
    m = module(EMPTY)
    near, far = memory_pair()
    with served(far, m, speed):
        near.write(wire(MANUAL))
        time.sleep(0.2)  # at 50 times real time ten seconds: five times what a late host may be
        decoder, received = PacketDecoder(), []
        while len(received) < 151:
            received += [decode_response(p.data) for p in decoder.feed(near.read(10.0))]
    assert [frame.info for frame in received[1:]] == list(range(1, len(received)))


def take(radar, n):
    with radar:
        return list(islice(radar.frames(), n)), radar.stream


def opened(port, n=40):
    return take(make_radar(parse_port(port), speed=None), n)


def test_an_x4_streams_through_the_same_device_class():
    port = "sim:human?device=x4m03&rate=30"
    frames, stream = opened(port)
    assert (stream.axis.kind, stream.frame_rate_hz) == ("baseband", 30)
    assert stream.axis.bin_length_m == pytest.approx(0.0514, abs=1e-4)
    assert frames[0].samples.dtype == np.complex64
    assert [f.index for f in frames] == list(range(40))
    assert np.array_equal(opened(port)[0][7].samples, frames[7].samples)
    frames, stream = opened(f"{port}&kind=rf", 5)
    assert stream.axis.kind == "rf"
    assert stream.axis.bin_length_m == pytest.approx(0.0064, abs=1e-4)
    assert frames[0].samples.dtype == np.float32


@pytest.mark.parametrize("output", ["iq", "ap"])
def test_a_profile_streams_baseband_at_20_hz(output):
    settings = ProfileSettings(output=output)
    radar = make_radar(parse_port("sim:human?device=x2m200"), speed=None, settings=settings)
    frames, stream = take(radar, 50)
    assert (stream.frame_rate_hz, stream.axis.n_range) == (20, 52)
    assert stream.axis.range_offset_m == pytest.approx(0.4)
    assert stream.axis.bin_length_m == pytest.approx(0.0384, abs=1e-4)
    assert [f.counter for f in frames] == list(range(1, 51))


def test_start_up_of_a_profile():
    s = ProfileSettings(profile="respiration", zone_start_m=0.5, zone_end_m=1.0)
    first, *commands, last = s.startup_commands()
    assert (first, last) == (msg.SetMode(ids.Mode.IDLE), msg.SetMode(ids.Mode.RUN))
    order = [type(c) for c in commands]
    assert order.index(msg.LoadProfile) < order.index(msg.SetOutput)
    assert msg.LoadProfile(ids.Profile.RESPIRATION) in commands
    assert msg.SetDetectionZone(0.5, 1.0) in commands
    for port in ("sim:empty?device=x2m200&rate=60", "sim:empty?device=x2m200&kind=rf"):
        with pytest.raises(SettingsError, match="profiles of an X2M200"):
            make_radar(parse_port(port))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"profile": "gait"}, "profile = 'gait': must be one of respiration, sleep, presence"),
        ({"zone_start_m": 0}, "zone_start_m"),
        ({"zone_start_m": 2, "zone_end_m": 1}, "must be above zone_start_m"),
        ({"sensitivity": 10}, "0 to 9"),
        ({"output": "rf", "led": 4}, "output.*led"),
    ],
)
def test_profile_settings_that_make_no_sense(wrong, said):
    with pytest.raises(SettingsError, match=said):
        ProfileSettings(**wrong)


@pytest.mark.integration
@pytest.mark.parametrize(
    ("firmware", "settings"),
    [(X2Firmware, RadarSettings.for_frame_rate(60)), (X4Firmware, X4Settings.for_frame_rate(60))],
)
def test_auto_asks_the_module_what_it_is(firmware, settings):
    with plugged(SimulatedModule(load_scene("empty"), firmware=firmware())) as far:
        radar = make_radar(parse_port(far.path))
        radar.identify()
        assert radar.settings == settings
        with radar:
            assert next(radar.frames()).axis.carrier_hz == settings.axis.carrier_hz


def test_order_codes():
    assert {module_for(code).device for code in ("X4M03", " xep-1")} == {"x4m03"}
    assert {module_for(code).device for code in ("", "X2M200", "NVA-R661")} == {"x2raw"}


def test_a_row_and_its_firmware_are_all_that_a_module_needs(monkeypatch):
    row = ModuleRow(
        device="mine", name="Mine", settings=X4Settings, order_codes=("X4M0",), bundle="mine"
    )
    monkeypatch.setitem(MODULES, "mine", row)
    monkeypatch.setitem(FIRMWARES, "mine", X4Firmware)
    frames, stream = opened("sim:human?device=mine&rate=20", 3)
    assert (len(frames), stream.frame_rate_hz, stream.axis.carrier_hz) == (3, 20, 7.29e9)
    assert module_for("X4M03") is row
    known = "x2raw, x2m200, x4m03, mine"
    for port, words in ("/dev/ttyX?device=x9", f"auto, {known}"), ("sim:human?device=auto", known):
        with pytest.raises(SettingsError, match=f"known are {words}"):
            make_radar(parse_port(port))
    assert make_radar(parse_port("/dev/ttyX?device=x2raw")).settings == RadarSettings()


@pytest.mark.parametrize("device", MODULES)
def test_a_module_streams_the_axis_of_its_settings(device):
    _, stream = opened(f"sim:empty?device={device}", 2)
    s = MODULES[device].settings.for_port(None, None)
    axis = s.axis
    assert (stream.frame_rate_hz, stream.axis.kind) == (s.frame_rate_hz, axis.kind)
    assert stream.axis.range_m == pytest.approx(axis.range_m)
    assert stream.axis.carrier_hz == pytest.approx(axis.carrier_hz)


def test_what_the_firmware_refuses():
    x2, x4 = X2Firmware(), X4Firmware()
    assert x4.obey(msg.SetMode(ids.Mode.MANUAL)).reply == msg.Ack()
    assert x4.obey(msg.X4Set(ids.X4Setting.FPS, (20.0,))).reply == REFUSED  # not initialised
    x4.obey(msg.X4Init())
    assert x4.obey(msg.X4Set(ids.X4Setting.FPS, (1e5,))).reply == REFUSED
    wanted = X4Settings(frame_rate_hz=20.0, is_baseband=False)
    assert x4.obey(msg.X4Set(ids.X4Setting.FPS, (20.0,))).starts == wanted
    assert x4.obey(msg.X4Set(ids.X4Setting.FPS, (0.0,))).stops
    assert x4.obey(msg.SetMode(99)).reply == x2.obey(msg.SetMode(99)).reply == REFUSED
    assert x4.obey(msg.SetOutput(ids.OutputRef.BASEBAND, ids.BasebandOutput.IQ)) is None
    assert x2.obey(msg.X4Init()) is None
    assert x2.obey(msg.SetMode(ids.Mode.RUN)).starts is None
    x2.obey(msg.LoadProfile(ids.Profile.SLEEP))
    x2.obey(msg.SetOutput(ids.OutputRef.BASEBAND, ids.BasebandOutput.IQ))
    x2.obey(msg.SetDetectionZone(2.0, 1.0))
    assert x2.obey(msg.SetMode(ids.Mode.RUN)).reply == REFUSED
    assert x4.obey(msg.X4Set(ids.X4Setting.ITERATIONS, (5,))).reply == msg.Ack()
    radar = make_radar(parse_port("sim:empty?device=x4m03"), speed=None, settings=RadarSettings())
    with pytest.raises(DeviceError, match="not recognized"):
        radar.open()
    code = x4.obey(msg.GetSystemInfo(ids.InfoItem.ORDER_CODE))
    assert code.reply == msg.Reply(0x58, 1, "X4M03-SIM")


@pytest.mark.parametrize("firmware", [X4Firmware, X2Firmware])
def test_a_capture_of_any_module_reads_back(tmp_path, firmware):
    settings = X4Settings() if firmware is X4Firmware else ProfileSettings()
    path = tmp_path / "w.x2cap"
    wire = CaptureWriter(path, {"settings": asdict(settings)})
    module = lambda: SimulatedModule(load_scene("human"), firmware=firmware())  # noqa: E731
    radar = X2Radar(lambda: connect(module, None), settings)
    radar.wrap_transport(lambda inner: CapturingTransport(inner, wire))
    frames, _ = take(radar, 30)
    wire.close()
    reader = open_recording(path)
    assert reader.stream.axis == frames[0].axis
    assert reader.n_frames >= 30
    assert np.array_equal(reader.read_samples(0, 30), [f.samples for f in frames])
