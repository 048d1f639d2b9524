"""From settings to the commands that configure a module and start its stream."""

from x2radar.messages import Message, SetMode, SetOutput, SetSysFloat, SetSysInt
from x2radar.settings import RadarSettings
from x2radar.wire_ids import BasebandOutput, Mode, OutputRef, SysCfg

_OUTPUTS = {
    "rf": BasebandOutput.OFF,
    "iq": BasebandOutput.IQ,
    "ap": BasebandOutput.AMPLITUDE_PHASE,
}


def startup_commands(settings: RadarSettings) -> tuple[Message, ...]:
    """Return what a freshly reset module is told, in order.

    Parameters
    ----------
    settings : RadarSettings
        Checked settings.

    Returns
    -------
    tuple of Message
        Every one is answered by ACK; nothing runs before the last, which starts the stream.
    """
    s = settings
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
