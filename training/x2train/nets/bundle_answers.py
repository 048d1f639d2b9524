"""What a bundle's network says of windows: of each alone, and of each after those before it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from radard.judge.classifier import FUSED_LOGITS, HIDDEN, NEXT_HIDDEN, Hidden, softmax
from radard.judge.onnx_runtime import ort

Array = NDArray[np.float64]
_AT_ONCE = 128  # windows a call: more cost memory and gain no time


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What a bundle's network gives for each of n windows."""

    # (n, n_classes): of every window alone, to be divided by the bundle's temperature
    logits: Array
    # (n, n_classes): of its temporal head, after this window and those before it; None without
    # one
    fused: Array | None = None
    hidden: Hidden | None = None  # (n, n_hidden): what the head was given with each window

    def p(self, temperature: float) -> Array:
        """Return the probabilities of every window alone."""
        rows = self.logits / temperature
        return np.stack([softmax(row) for row in rows]) if len(rows) else rows

    def fused_log_p(self) -> Array | None:
        """Return the head's log-probabilities, shape (n, n_classes); None without a head."""
        if self.fused is None:
            return None
        return np.asarray(log_softmax(self.fused, axis=1))


def outputs_of(
    onnx_bytes: bytes,
    inputs: Mapping[str, NDArray[Any]],
    *,
    is_first: NDArray[np.bool_] | None = None,
) -> Answers:
    """Return the answers to windows, floats or bytes; `is_first` where the gate has opened."""
    return _run(onnx_bytes, inputs, is_first, "")[0]


def tapped(
    onnx_bytes: bytes, inputs: Mapping[str, NDArray[Any]], name: str
) -> tuple[Answers, NDArray[np.float32]]:
    """Return the answers to windows alone, and another output of a network."""
    return _run(onnx_bytes, inputs, None, name)


def _run(
    onnx_bytes: bytes,
    inputs: Mapping[str, NDArray[Any]],
    is_first: NDArray[np.bool_] | None,
    tap: str,
) -> tuple[Answers, NDArray[np.float32]]:
    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = ort.InferenceSession(onnx_bytes, options, providers=["CPUExecutionProvider"])
    n = len(next(iter(inputs.values())))
    n_hidden = next((i.shape[1] for i in session.get_inputs() if i.name == HIDDEN), 0)
    names = ["logits", *([FUSED_LOGITS, NEXT_HIDDEN] if n_hidden else []), *([tap] if tap else [])]
    firsts = is_first if is_first is not None and n_hidden else np.ones(n, bool)
    before = np.zeros((n, n_hidden), np.float32)
    made: dict[str, NDArray[Any]] = {}
    for rows in _in_turn(firsts):
        feed = {key: _as_float(values[rows]) for key, values in inputs.items()}
        if n_hidden:
            if NEXT_HIDDEN in made:
                before[rows] = np.where(firsts[rows, None], 0, made[NEXT_HIDDEN][rows - 1])
            feed[HIDDEN] = before[rows]
        for name, values in zip(names, session.run(names, feed), strict=True):
            if name not in made:
                made[name] = np.zeros((n, *values.shape[1:]), np.float32)
            made[name][rows] = values
    n_out = session.get_outputs()[0].shape[1]
    logits = made.get("logits", np.zeros((0, n_out))).astype(np.float64)
    answers = Answers(logits)
    if is_first is not None and n_hidden:
        answers = Answers(logits, made[FUSED_LOGITS].astype(np.float64), before)
    return answers, made.get(tap, np.zeros((n, 0), np.float32))


def _in_turn(is_first: NDArray[np.bool_]) -> Iterator[NDArray[np.int64]]:
    """Yield batches of windows, each window in a later batch than the one before it."""
    number = np.arange(len(is_first))
    begin = np.maximum.accumulate(np.where(is_first, number, 0))
    at = number - begin
    for k in range(int(at.max(initial=-1)) + 1):
        rows = np.flatnonzero(at == k)
        for first in range(0, len(rows), _AT_ONCE):
            yield rows[first : first + _AT_ONCE]


def _as_float(values: NDArray[Any]) -> NDArray[np.float32]:
    if values.dtype == np.uint8:
        return np.asarray(values / np.float32(255), np.float32)
    return np.asarray(values, np.float32)
