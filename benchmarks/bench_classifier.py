"""What a window costs in onnxruntime, in single precision and quantised to int8, in one run.

Weights and activations are quantised statically, per channel, calibrated on maps of noise: for
time it does not matter on what. Medians of interleaved calls on one thread.
"""

import argparse
import json
import logging
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime as ort
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

from radard.bundle import load_bundle
from radard.classifier import HIDDEN


class _Maps(CalibrationDataReader):
    def __init__(self, inputs: list[dict[str, Any]]) -> None:
        self._rows: Iterator[dict[str, Any]] = iter(inputs)

    def get_next(self) -> dict[str, Any] | None:
        return next(self._rows, None)


def _session(path: Path) -> ort.InferenceSession:
    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return ort.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", nargs="+", default=["balanced"])
    parser.add_argument("--calls", type=int, default=500)
    args = parser.parse_args()
    logging.disable(logging.WARNING)
    rng = np.random.default_rng(0)
    sessions, feeds = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        for name in args.models:
            bundle = load_bundle(name)
            shapes = {i.name: i.shape for i in bundle.inputs}
            shapes |= {HIDDEN: (bundle.n_hidden,)} if bundle.n_hidden else {}
            rows = [
                {name: rng.random((1, *shape), np.float32) for name, shape in shapes.items()}
                for _ in range(16)
            ]
            onnx = Path(folder) / f"{Path(name).stem}.onnx"
            onnx.write_bytes(bundle.onnx)
            small = onnx.with_suffix(".int8.onnx")
            quantize_static(
                onnx,
                small,
                _Maps(rows),
                quant_format=QuantFormat.QDQ,
                per_channel=True,
                weight_type=QuantType.QInt8,
            )
            for kind, path in (("fp32", onnx), ("int8", small)):
                sessions[name, kind], feeds[name, kind] = _session(path), rows[0]
        took_s: dict[tuple[str, str], list[float]] = {key: [] for key in sessions}
        for _ in range(args.calls):
            for key, session in sessions.items():
                started_s = time.perf_counter()
                session.run(None, feeds[key])
                took_s[key].append(time.perf_counter() - started_s)
    us = {f"us_{name}_{kind}": 1e6 * float(np.median(t)) for (name, kind), t in took_s.items()}
    for name in args.models:
        us[f"int8_speedup_{name}"] = us[f"us_{name}_fp32"] / us[f"us_{name}_int8"]
    print(json.dumps({key: round(value, 3) for key, value in us.items()}, indent=2))


if __name__ == "__main__":
    main()
