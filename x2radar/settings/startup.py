"""From settings to the commands that configure a module and start its stream."""

from x2radar.settings.any import ModuleSettings
from x2radar.settings.profile import PROFILES, ProfileSettings
from x2radar.settings.x2 import RadarSettings
from x2radar.settings.x4 import X4Settings
from x2radar.wire.messages import (
    LoadProfile,
    Message,
    SetDetectionZone,
    SetLed,
    SetMode,
    SetOutput,
    SetSensitivity,
    SetSysFloat,
    SetSysInt,
)
from x2radar.wire.messages_x4 import (
    X4Init,
    X4SetCentreFrequency,
    X4SetDacMax,
    X4SetDacMin,
    X4SetDacStep,
    X4SetDownConversion,
    X4SetFrameArea,
    X4SetFrameAreaOffset,
    X4SetFrameRate,
    X4SetIterations,
    X4SetPrfDivider,
    X4SetPulsesPerStep,
)
from x2radar.wire.wire_ids import BasebandOutput, Mode, OutputRef, SysCfg

_OUTPUTS = {
    "rf": BasebandOutput.OFF,
    "iq": BasebandOutput.IQ,
    "ap": BasebandOutput.AMPLITUDE_PHASE,
}


def startup_commands(settings: ModuleSettings) -> tuple[Message, ...]:
    """Return what a freshly reset module is told, in order.

    Parameters
    ----------
    settings : RadarSettings, X4Settings or ProfileSettings
        Checked settings.

    Returns
    -------
    tuple of Message
        Every one is answered by ACK; nothing runs before the last, which starts the stream.
    """
    if isinstance(settings, X4Settings):
        return _x4(settings)
    return _profile(settings) if isinstance(settings, ProfileSettings) else _x2(settings)


def _x2(s: RadarSettings) -> tuple[Message, ...]:
    return (
        SetMode(Mode.IDLE),
        SetSysInt(SysCfg.PG_SELECT, s.pulse_generator),
        SetSysInt(SysCfg.FRAME_STITCH, s.frame_stitch),
        SetSysInt(SysCfg.DAC_MIN, s.dac_min),
        SetSysInt(SysCfg.DAC_MAX, s.dac_max),
        SetSysInt(SysCfg.DAC_STEP, s.dac_step),
        SetSysInt(SysCfg.PULSES_PER_STEP, s.pulses_per_step),
        SetSysInt(SysCfg.ITERATIONS, s.iterations),
        SetSysInt(SysCfg.FPS, round(s.frame_rate_hz)),
        SetSysFloat(SysCfg.SAMPLE_DELAY, s.sample_delay_s),
        SetOutput(OutputRef.BASEBAND, _OUTPUTS[s.output]),
        SetMode(Mode.MANUAL),
    )


def _profile(s: ProfileSettings) -> tuple[Message, ...]:
    # In the order of clients of real modules: the output between profile and start.
    return (
        SetMode(Mode.IDLE),
        LoadProfile(PROFILES[s.profile].app_id),
        SetLed(s.led),
        SetDetectionZone(s.zone_start_m, s.zone_end_m),
        SetSensitivity(s.sensitivity),
        SetOutput(OutputRef.BASEBAND, _OUTPUTS[s.output]),
        SetMode(Mode.RUN),
    )


def _x4(s: X4Settings) -> tuple[Message, ...]:
    return (
        SetMode(Mode.STOP),
        SetMode(Mode.MANUAL),
        X4Init(),
        X4SetDownConversion(int(s.is_baseband)),
        X4SetCentreFrequency(s.centre_frequency),
        X4SetPrfDivider(s.prf_divider),
        X4SetIterations(s.iterations),
        X4SetPulsesPerStep(s.pulses_per_step),
        X4SetDacStep(s.dac_step),
        X4SetDacMin(s.dac_min),
        X4SetDacMax(s.dac_max),
        X4SetFrameAreaOffset(s.area_offset_m),
        X4SetFrameArea(s.area_start_m, s.area_end_m),
        X4SetFrameRate(s.frame_rate_hz),
    )
