"""Fast-time axes that tests share."""

from dataclasses import replace

from x2radar.frame import FastTimeAxis
from x2radar.modules.x2 import RadarSettings


def axis_of(kind, settings=None):
    """The axis of a module's frames with `settings`, or with the defaults."""
    s = settings or RadarSettings()
    return FastTimeAxis(
        kind=kind,
        n_range=s.n_range,
        bin_length_m=s.bin_length_m,
        range_offset_m=s.range_offset_m,
        carrier_hz=s.carrier_hz,
        bandwidth_hz=s.bandwidth_hz,
        sample_rate_hz=s.sample_rate_hz,
    )


def axis_with(kind, n_range, *numbers, **others):
    """An axis of bins: their length, their offset, carrier, bandwidth, sampling, or the X2's."""
    names = ("bin_length_m", "range_offset_m", "carrier_hz", "bandwidth_hz", "sample_rate_hz")
    named = dict(zip(names, numbers, strict=False))
    return replace(axis_of(kind), n_range=n_range, **named, **others)
