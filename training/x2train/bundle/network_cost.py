"""What a network costs: its time a window, and it in int8."""

import logging
import statistics
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from radard.judge.onnx_runtime import ort

Feed = Mapping[str, NDArray[np.float32]]
_Key = TypeVar("_Key")


def window_ms(nets: Mapping[_Key, tuple[bytes, Feed]], calls: int) -> dict[_Key, float]:
    """Return the CPU time of a window on one thread, in milliseconds, of networks in turn.

    Networks come with what each is given; the median of `calls` counts.
    """
    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    sessions = {
        key: ort.InferenceSession(net, options, providers=["CPUExecutionProvider"])
        for key, (net, _) in nets.items()
    }
    took_s: dict[_Key, list[float]] = {key: [] for key in nets}
    for _ in range(calls):
        for key, session in sessions.items():
            started_s = time.thread_time()
            session.run(None, dict(nets[key][1]))
            took_s[key].append(time.thread_time() - started_s)
    return {key: 1e3 * statistics.median(each) for key, each in took_s.items()}


def quantised(onnx_bytes: bytes, rows: Sequence[Feed]) -> bytes:
    """Return a network with weights and activations in int8, weights by channel.

    Ranges of activations are those that `rows` bring about: what it may be given, each of shape
    (1, ...), float32. Quantised statically (QDQ), with the same inputs and outputs. Weights use
    seven of their eight bits: without dot-product instructions (VNNI) onnxruntime adds pairs of
    products in 16 bits, where 255 x 127 x 2 saturates and 255 x 64 x 2 does not.
    """
    # It imports onnxruntime: only after `radard.judge.onnx_runtime` has done so.
    from onnxruntime.quantization import (  # noqa: PLC0415, TID251
        QuantFormat,
        QuantType,
        quantize_static,
    )

    root = logging.getLogger()
    level = root.level
    # It advises, on the root logger, to fold batch norms first: the export has done so.
    root.setLevel(logging.ERROR)
    try:
        with tempfile.TemporaryDirectory() as folder:
            whole, small = Path(folder) / "fp32.onnx", Path(folder) / "int8.onnx"
            whole.write_bytes(onnx_bytes)
            quantize_static(
                whole,
                small,
                _Rows(rows),
                quant_format=QuantFormat.QDQ,
                per_channel=True,
                reduce_range=True,
                weight_type=QuantType.QInt8,
            )
            return small.read_bytes()
    finally:
        root.setLevel(level)


class _Rows:
    """What onnxruntime calls a CalibrationDataReader, without its import."""

    def __init__(self, rows: Sequence[Feed]) -> None:
        self._rows: Iterator[Feed] = iter(rows)

    def get_next(self) -> dict[str, Any] | None:
        row = next(self._rows, None)
        return None if row is None else dict(row)
