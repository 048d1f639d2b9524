"""Settings to commands: order, completeness, bytes."""

import pytest

from x2radar.modules.x2 import RadarSettings
from x2radar.modules.x4 import X4Settings
from x2radar.wire.codec import decode_command, encode
from x2radar.wire.messages import SetMode, SetOutput, SetSysFloat, SetSysInt, X4Init, X4Set
from x2radar.wire.wire_ids import BasebandOutput, Mode, OutputRef, SysCfg, X4Setting


@pytest.mark.parametrize(
    ("output", "value"),
    [
        ("rf", BasebandOutput.OFF),
        ("iq", BasebandOutput.IQ),
        ("ap", BasebandOutput.AMPLITUDE_PHASE),
    ],
)
def test_x2(output, value):
    s = RadarSettings(frame_rate_hz=20, pulse_generator=6, frame_stitch=2, output=output)
    first, *between, last = s.startup_commands()
    assert (first, last) == (SetMode(Mode.IDLE), SetMode(Mode.MANUAL))
    assert between[-1] == SetOutput(OutputRef.BASEBAND, value)
    assert SetSysInt(SysCfg.FPS, 20) in between
    assert SetSysFloat(SysCfg.SAMPLE_DELAY, s.sample_delay_s) in between
    assert SetSysInt(SysCfg.PG_SELECT, 6) in between
    assert SetSysInt(SysCfg.FRAME_STITCH, 2) in between


def test_x4():
    s = X4Settings(
        frame_rate_hz=20,
        area_start_m=0.5,
        area_end_m=4,
        area_offset_m=0.25,
        is_baseband=False,
        centre_frequency=4,
        dac_min=900,
        dac_max=1150,
        dac_step=2,
        pulses_per_step=10,
        iterations=16,
        prf_divider=8,
    )
    first, second, third, *between, last = s.startup_commands()
    assert (first, second, third) == (SetMode(Mode.STOP), SetMode(Mode.MANUAL), X4Init())
    assert last == X4Set(X4Setting.FPS, (20,))
    assert set(between) == {
        X4Set(X4Setting.DOWN_CONVERSION, (0,)),
        X4Set(X4Setting.TX_CENTRE_FREQUENCY, (4,)),
        X4Set(X4Setting.PRF_DIV, (8,)),
        X4Set(X4Setting.ITERATIONS, (16,)),
        X4Set(X4Setting.PULSES_PER_STEP, (10,)),
        X4Set(X4Setting.DAC_STEP, (2,)),
        X4Set(X4Setting.DAC_MIN, (900,)),
        X4Set(X4Setting.DAC_MAX, (1150,)),
        X4Set(X4Setting.FRAME_AREA_OFFSET, (0.25,)),
        X4Set(X4Setting.FRAME_AREA, (0.5, 4)),
    }
    told = [command.setting for command in between]
    assert told.index(X4Setting.FRAME_AREA_OFFSET) < told.index(X4Setting.FRAME_AREA)


@pytest.mark.parametrize("settings", [RadarSettings(), X4Settings(frame_rate_hz=17)])
def test_every_command_has_bytes(settings):
    for command in settings.startup_commands():
        assert type(decode_command(encode(command))) is type(command)
