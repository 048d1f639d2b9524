"""Other modules than the X2 in MANUAL mode, through the same driver: X4M03 and X2M200."""

from dataclasses import asdict
from itertools import islice

import numpy as np
import pytest

from tests.device_helpers import plugged
from x2radar.device.device import X2Radar
from x2radar.errors import DeviceError, SettingsError
from x2radar.modules.modules import MODULES, ModuleRow, module_for
from x2radar.modules.profile import ProfileSettings
from x2radar.modules.x2 import RadarSettings
from x2radar.modules.x4 import X4Settings
from x2radar.ports import parse_port
from x2radar.radars import make_radar
from x2radar.recording.capture import CaptureWriter, capturing
from x2radar.recording.registry import open_recording
from x2radar.sim.module.firmware import FIRMWARES, X2Firmware, X4Firmware
from x2radar.sim.module.host import connect
from x2radar.sim.module.module import SimulatedModule
from x2radar.sim.scene.scene import load_scene
from x2radar.wire import messages as msg
from x2radar.wire import wire_ids as ids

REFUSED = msg.ErrorReply(ids.ErrorCode.COMMAND_FAILED)


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
    assert x4.obey(msg.X4Set(ids.X4Setting.FPS, (20.0,))).starts == X4Settings(
        frame_rate_hz=20.0, is_baseband=False
    )
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
    assert x4.obey(msg.GetSystemInfo(ids.InfoItem.ORDER_CODE)).reply == msg.Reply(
        0x58, 1, "X4M03-SIM"
    )


@pytest.mark.parametrize("firmware", [X4Firmware, X2Firmware])
def test_a_capture_of_any_module_reads_back(tmp_path, firmware):
    settings = X4Settings() if firmware is X4Firmware else ProfileSettings()
    path = tmp_path / "w.x2cap"
    wire = CaptureWriter(path, {"settings": asdict(settings)})
    module = lambda: SimulatedModule(load_scene("human"), firmware=firmware())  # noqa: E731
    radar = X2Radar(lambda: connect(module, None), settings)
    radar.wrap_transport(lambda inner: capturing(inner, wire))
    frames, _ = take(radar, 30)
    wire.close()
    reader = open_recording(path)
    assert reader.stream.axis == frames[0].axis
    assert reader.n_frames >= 30
    assert np.array_equal(reader.read_samples(0, 30), [f.samples for f in frames])
