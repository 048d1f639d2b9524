"""Fast-time axes that tests share."""

from dataclasses import replace

from x2radar.modules.x2 import RadarSettings


def axis_of(kind, settings=None):
    """The axis of a module's frames with `settings`, or with the defaults."""
    return replace((settings or RadarSettings()).axis, kind=kind)


def axis_with(kind, n_range, *numbers, **others):
    """An axis of bins: their length, their offset, carrier, bandwidth, sampling, or the X2's."""
    names = ("bin_length_m", "range_offset_m", "carrier_hz", "bandwidth_hz", "sample_rate_hz")
    named = dict(zip(names, numbers, strict=False))
    return replace(axis_of(kind), n_range=n_range, **named, **others)
