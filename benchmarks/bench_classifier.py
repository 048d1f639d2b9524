"""What a window costs in onnxruntime, in single precision and quantised to int8, in one run.

Weights and activations are quantised statically, per channel, calibrated on maps of noise: for
time it does not matter on what. Medians of the CPU time of interleaved calls on one thread.
"""

import argparse
import json
import logging
import tempfile
from pathlib import Path

import numpy as np

from radard.judge.bundle import load_bundle
from radard.judge.classifier import HIDDEN
from x2train.nets.bundle_answers import Feed, window_ms


class _Rows:
    """What onnxruntime calls a CalibrationDataReader."""

    def __init__(self, rows: list[Feed]) -> None:
        self._rows = iter(rows)

    def get_next(self) -> Feed | None:
        return next(self._rows, None)


def quantised(onnx_bytes: bytes, rows: list[Feed]) -> bytes:
    """Return a network with weights and activations in int8, weights by channel (QDQ).

    Ranges of activations are those of `rows`. Weights use seven of their eight bits: without
    dot-product instructions (VNNI) onnxruntime adds pairs of products in 16 bits, where
    255 x 127 x 2 saturates and 255 x 64 x 2 does not.
    """
    # It imports onnxruntime: only after `radard.judge.onnx_runtime` has done so.
    from onnxruntime import quantization  # noqa: PLC0415, TID251

    # It advises, on the root logger, to fold batch norms first: the export has done so.
    logging.getLogger().setLevel(logging.ERROR)
    with tempfile.TemporaryDirectory() as folder:
        whole, small = Path(folder) / "fp32.onnx", Path(folder) / "int8.onnx"
        whole.write_bytes(onnx_bytes)
        quantization.quantize_static(
            whole,
            small,
            _Rows(rows),
            quant_format=quantization.QuantFormat.QDQ,
            per_channel=True,
            reduce_range=True,
            weight_type=quantization.QuantType.QInt8,
        )
        return small.read_bytes()


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", nargs="+", default=["balanced"])
    parser.add_argument("--calls", type=int, default=500)
    args = parser.parse_args()
    rng = np.random.default_rng(0)
    nets: dict[tuple[str, str], tuple[bytes, Feed]] = {}
    for name in args.models:
        bundle = load_bundle(name)
        shapes = {i.name: i.shape for i in bundle.inputs}
        shapes |= {HIDDEN: (bundle.n_hidden,)} if bundle.n_hidden else {}
        rows = [
            {key: rng.random((1, *shape), np.float32) for key, shape in shapes.items()}
            for _ in range(16)
        ]
        nets[name, "fp32"] = bundle.onnx, rows[0]
        nets[name, "int8"] = quantised(bundle.onnx, rows), rows[0]
    ms = window_ms(nets, args.calls)
    us = {f"us_{name}_{kind}": 1e3 * value for (name, kind), value in ms.items()}
    for name in args.models:
        us[f"int8_speedup_{name}"] = us[f"us_{name}_fp32"] / us[f"us_{name}_int8"]
    print(json.dumps({key: round(value, 3) for key, value in us.items()}, indent=2))


if __name__ == "__main__":
    main()
