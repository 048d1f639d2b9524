"""Which bundle judges a stream when the configuration names none."""

from radard.config.profiles import front
from radard.config.sections import AUTO_MODEL, DEFAULT_MODEL
from radard.judge.bundle import Bundle, load_bundle
from radard.judge.evidence import HOP_S, windows_a_feed
from x2radar.frame import StreamInfo
from x2radar.modules.modules import MODULES

OF_ONE_MODULE = tuple(row.bundle for row in MODULES.values() if row.bundle)
"""Bundles of one module, for its streams that `DEFAULT_MODEL` does not take."""


def model_for(name: str, stream: StreamInfo | None = None) -> str:
    """Return the name of the bundle that `name` means; `AUTO_MODEL` goes by the bandwidth."""
    if name != AUTO_MODEL:
        return name
    if stream is None or stream.axis.bandwidth_hz == 0:
        return DEFAULT_MODEL
    axis, rate_hz = stream.axis, stream.frame_rate_hz
    known = (DEFAULT_MODEL, *OF_ONE_MODULE)
    return next((each for each in known if load_bundle(each).takes(axis, rate_hz)), DEFAULT_MODEL)


def hop_warning(bundle: Bundle, hop_s: float, profile: str | None = None) -> str:
    """Return what decisions `hop_s` apart mean for a bundle with a memory; empty if nothing."""
    measured = front().named(profile)
    if hop_s in {HOP_S, measured.hop_s if measured else HOP_S} or not bundle.n_hidden:
        return ""
    return (
        f"decision.hop_s {hop_s:g}: model '{bundle.name}' learned from windows {HOP_S:g} s apart, "
        f"and its memory now spans {windows_a_feed(hop_s) * hop_s:g} s from one to the next; "
        f"the rates of its card hold at {HOP_S:g} s"
    )
