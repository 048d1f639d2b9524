"""Which bundle judges a stream when the configuration names none."""

from radard.config.sections import AUTO_MODEL, DEFAULT_MODEL
from radard.judge.bundle import load_bundle
from x2radar.frame import StreamInfo
from x2radar.modules.modules import MODULES

OF_ONE_MODULE = tuple(row.bundle for row in MODULES.values() if row.bundle)
"""Bundles that were made for one module: they judge its streams that `DEFAULT_MODEL` does not
take."""


def model_for(name: str, stream: StreamInfo | None = None) -> str:
    """Return the name of the bundle that `name`, of the configuration's `model.name`, means.

    All but `AUTO_MODEL` means itself. That is `DEFAULT_MODEL`, unless only a bundle in
    `OF_ONE_MODULE` takes such streams; without a stream, or if its bandwidth is not known, no
    module can be told from another.
    """
    if name != AUTO_MODEL:
        return name
    if stream is None or stream.axis.bandwidth_hz == 0:
        return DEFAULT_MODEL
    axis, rate_hz = stream.axis, stream.frame_rate_hz
    known = (DEFAULT_MODEL, *OF_ONE_MODULE)
    return next((each for each in known if load_bundle(each).takes(axis, rate_hz)), DEFAULT_MODEL)
