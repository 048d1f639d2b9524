"""Classifier: Features to class probabilities, by a bundle's network in onnxruntime."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from radard.errors import ModelMismatch
from radard.judge.bundle import CLASSES, Bundle
from radard.judge.features import Features

HIDDEN, FUSED_LOGITS, NEXT_HIDDEN = "hidden", "fused_logits", "next_hidden"
"""What a network with a temporal head takes besides, and gives besides."""
Hidden: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Probabilities:
    """Calibrated probabilities of one window; they sum to one within 1e-6."""

    human: float
    pet: float
    other: float


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """Probabilities that a network gives a window, by itself and with those before it."""

    window: Probabilities  # of the window alone
    # Log-probabilities of `CLASSES` by this window and those before it, -inf for a class that the
    # network does not know; None without a temporal head.
    fused_log_p: NDArray[np.float64] | None = None
    hidden: Hidden | None = None  # shape (n_hidden,), to be given back with the next window


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Features that the network was given, and its answer."""

    features: Features
    hidden: Hidden | None
    answer: Answer


class Classifier:
    """Run a bundle's network; ModelMismatch unless it is what the sidecar says."""

    def __init__(self, bundle: Bundle) -> None:
        self.bundle = bundle
        self.feature_names = tuple(i.feature for i in bundle.inputs)  # in the inputs' order
        # Here, because `--model none` must not pay for it.
        from radard.judge.onnx_runtime import ort  # noqa: PLC0415

        options = ort.SessionOptions()
        # One thread and no spinning: on so small a network anything else only burns a core.
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 3
        try:
            own = ["CPUExecutionProvider"]
            self._session = ort.InferenceSession(bundle.onnx, options, providers=own)
        except Exception as err:
            msg = f"model '{bundle.name}': onnxruntime cannot load it: {err}"
            raise ModelMismatch(msg) from err
        wanted = {i.name: [1, *i.shape] for i in bundle.inputs}
        self._outputs = ["logits"]
        if bundle.n_hidden:
            wanted[HIDDEN] = [1, bundle.n_hidden]
            self._outputs += [FUSED_LOGITS, NEXT_HIDDEN]
        found = {i.name: [1, *i.shape[1:]] for i in self._session.get_inputs()}
        n_out = self._session.get_outputs()[0].shape[-1]
        if wanted != found or n_out != len(bundle.classes):
            raise ModelMismatch(
                f"model '{bundle.name}': the network takes {found} and gives {n_out} classes, "
                f"the sidecar says {wanted} and {len(bundle.classes)}"
            )
        missing = set(self._outputs) - {o.name for o in self._session.get_outputs()}
        if missing:
            msg = f"model '{bundle.name}': the network does not give {', '.join(sorted(missing))}"
            raise ModelMismatch(msg)

    def answer(self, features: Features, hidden: Hidden | None = None) -> Answer:
        """Return what the network says, after `hidden` of the window before; or ModelMismatch."""
        bundle = self.bundle
        feed = {i.name: features[i.feature][None] for i in bundle.inputs}
        if bundle.n_hidden:
            before = np.zeros(bundle.n_hidden, np.float32) if hidden is None else hidden
            feed[HIDDEN] = before[None]
        logits, *more = (np.asarray(made)[0] for made in self._session.run(self._outputs, feed))
        for values in (logits, *more):
            if not np.isfinite(values).all():
                raise ModelMismatch(f"model '{bundle.name}' answered {values}")
        p = softmax(logits.astype(np.float64) / bundle.temperature)
        by_class = dict(zip(bundle.classes, p, strict=True))
        window = Probabilities(*(float(by_class.get(name, 0.0)) for name in CLASSES))
        if not more:
            return Answer(window)
        z = more[0].astype(np.float64)
        z -= z.max()
        known = dict(zip(bundle.classes, z - np.log(np.exp(z).sum()), strict=True))
        fused = np.array([known.get(name, -np.inf) for name in CLASSES])
        return Answer(window, fused, more[1])


def softmax(logits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return exp(x) / sum exp(x) of a vector, without overflow for any finite input."""
    e = np.exp(logits - logits.max())
    return np.asarray(e / e.sum())
