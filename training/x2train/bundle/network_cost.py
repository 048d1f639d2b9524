"""What a network costs: its time a window."""

import statistics
import time
from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from radard.judge.onnx_runtime import ort

Feed = Mapping[str, NDArray[np.float32]]
_Key = TypeVar("_Key")


def window_ms(nets: Mapping[_Key, tuple[bytes, Feed]], calls: int) -> dict[_Key, float]:
    """Return the CPU time of a window on one thread, in ms, the median of `calls`."""
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
