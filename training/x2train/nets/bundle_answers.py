"""What a bundle's network says of windows, each alone and after those before it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from radard.judge.bundle import Bundle
from radard.judge.classifier import FUSED_LOGITS, HIDDEN, NEXT_HIDDEN, Hidden, softmax
from radard.judge.onnx_runtime import ort
from x2train.sets.window_set import Columns, check_made_for, inputs_of

Array = NDArray[np.float64]
_AT_ONCE = 128  # windows a call: more cost memory and gain no time


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What a bundle's network gives for each of n windows."""

    # (n, n_classes): of every window alone, to be divided by the bundle's temperature
    logits: Array
    # (n, n_classes): of its temporal head, after all windows so far; None without one
    fused: Array | None = None
    hidden: Hidden | None = None  # (n, n_hidden): what the head was given with each window
    tapped: Any = None  # (n, ...), float32: of another output that was asked for

    def p(self, temperature: float) -> Array:
        """Return the probabilities of every window alone."""
        rows = self.logits / temperature
        return np.stack([softmax(row) for row in rows]) if len(rows) else rows

    def fused_log_p(self) -> Array | None:
        """Return the head's log-probabilities, shape (n, n_classes); None without a head."""
        return None if self.fused is None else np.asarray(log_softmax(self.fused, axis=1))


def session_of(onnx_bytes: bytes) -> Any:
    """Return what runs a network on one thread of a processor."""
    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return ort.InferenceSession(onnx_bytes, options, providers=["CPUExecutionProvider"])


def outputs_of(
    onnx_bytes: bytes,
    inputs: Mapping[str, NDArray[Any]],
    *,
    is_first: NDArray[np.bool_] | None = None,
    tap: str = "",
) -> Answers:
    """Return the answers to windows, floats or bytes; `is_first` where the gate has opened.

    Without it each window is alone. `tap` names another output of the network.
    """
    session = session_of(onnx_bytes)
    n = len(next(iter(inputs.values())))
    n_hidden = next((i.shape[1] for i in session.get_inputs() if i.name == HIDDEN), 0)
    names = ["logits", *([FUSED_LOGITS, NEXT_HIDDEN] if n_hidden else []), *([tap] if tap else [])]
    firsts = is_first if is_first is not None and n_hidden else np.ones(n, bool)
    before = np.zeros((n, n_hidden), np.float32)
    made: dict[str, NDArray[Any]] = {}
    for rows in _in_turn(firsts):
        feed = {
            name: np.asarray(v / np.float32(255) if v.dtype == np.uint8 else v, np.float32)
            for name, v in ((name, values[rows]) for name, values in inputs.items())
        }
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
    if is_first is None or not n_hidden:
        return Answers(logits, tapped=made.get(tap))
    return Answers(logits, made[FUSED_LOGITS].astype(np.float64), before, made.get(tap))


def taught_by(
    bundle: Bundle, windows: Columns, about: Mapping[str, Any], folder: Path
) -> NDArray[np.float32]:
    """Return a teacher's calibrated probabilities of a set's windows, (n, 3); or UsageError.

    A smaller network learns from them beside the labels, which do not say how much could be seen
    (Hinton, Vinyals and Dean, "Distilling the knowledge in a neural network", 2015, recalled).
    """
    check_made_for(bundle, windows, about, folder)
    answers = outputs_of(bundle.onnx, inputs_of(bundle, windows))
    return answers.p(bundle.temperature).astype(np.float32)


def _in_turn(is_first: NDArray[np.bool_]) -> Iterator[NDArray[np.int64]]:
    """Yield batches of windows, each window in a later batch than the one before it."""
    number = np.arange(len(is_first))
    begin = np.maximum.accumulate(np.where(is_first, number, 0))
    at = number - begin
    for k in range(int(at.max(initial=-1)) + 1):
        rows = np.flatnonzero(at == k)
        for first in range(0, len(rows), _AT_ONCE):
            yield rows[first : first + _AT_ONCE]
