"""Evaluate: what an exported network does on windows that training never saw."""

import numpy as np

from radard.classify.classifier import softmax
from radard.classify.onnx_runtime import ort
from x2train.studies.baseline.dataset import CLASSES, LabelledSet

PET_LIMIT = 0.8


def window_metrics(onnx_bytes: bytes, temperature: float, test: LabelledSet) -> dict[str, float]:
    """Return accuracy, cross-entropy, and the daemon's verdict on every body.

    Parameters
    ----------
    onnx_bytes : bytes
        The exported network; it is run by onnxruntime, as in the daemon.
    temperature : float
        Logits are divided by it.
    test : LabelledSet
        Windows of their own draws.

    Returns
    -------
    dict of str to float
        Rounded to four digits.
    """
    session = ort.InferenceSession(onnx_bytes, providers=["CPUExecutionProvider"])
    logits = np.asarray(session.run(None, {"features": test.x})[0], np.float64)
    p = np.stack([softmax(row / temperature) for row in logits])
    guess = p.argmax(axis=1)
    truth = p[np.arange(len(test.y)), test.y]
    quiet = p[:, CLASSES.index("pet")] > PET_LIMIT
    body = np.array(test.body)
    metrics = {
        "windows": float(len(test.y)),
        "accuracy": float((guess == test.y).mean()),
        "cross-entropy": float(-np.log(np.maximum(truth, 1e-12)).mean()),
    }
    for label, name in enumerate(CLASSES):
        metrics[f"accuracy {name}"] = float((guess == test.y)[test.y == label].mean())
    for name in sorted(set(test.body)):
        metrics[f"share without alarm, {name}"] = float(quiet[body == name].mean())
    return {key: round(value, 4) for key, value in metrics.items()}
