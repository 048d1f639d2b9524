"""onnxruntime without its telemetry: the one file that imports it first.

From 1.31 on, onnxruntime's builds carry an uploader that opens TLS connections to the vendor and
keeps a device id in the user's cache folder. Its Privacy.md names the switch that prevents both:
`ORT_DISABLE_TELEMETRY=1` in the environment before the library is loaded.
"""

import os

os.environ["ORT_DISABLE_TELEMETRY"] = "1"

import onnxruntime as ort  # noqa: TID251 - the switch is read while the library loads

__all__ = ["ort"]
