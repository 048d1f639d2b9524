"""Model bundle: what a sidecar says, read and checked.

A bundle is three files: NAME.onnx (weights), NAME.json (sidecar) and NAME.md (card). The
sidecar says which features go in, with which settings, for which streams the network was
trained, and the hash of the weights. Nothing is guessed: what does not fit is refused, and so is
a network with weights in other files or operators of other libraries (`onnx_safety`).
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from radard.errors import BundleError, ModelMismatch
from radard.judge.features import FeatureSettings, feature_shape
from radard.judge.onnx_safety import unsafe_in
from x2radar.errors import renamed
from x2radar.frame import FastTimeAxis

SCHEMA = 1
CLASSES = ("human", "pet", "other")
POLICIES = ("window", "fused")
_MOST_HIDDEN = 4096  # chosen: far more than any head here, little enough to keep
_MOST_MESSAGE = 500  # characters of what is wrong; chosen: a sidecar's values may be of any length
_STREAM_KEYS = ("frame_rate_hz", "bin_length_m", "carrier_hz", "bandwidth_hz")


@dataclass(frozen=True, slots=True)
class ModelInput:
    """One input of the network: its name, its shape without batch, the feature it takes."""

    name: str
    shape: tuple[int, ...]
    feature: str


@dataclass(frozen=True, slots=True)
class Bundle:
    """A sidecar, read and checked."""

    name: str
    onnx: bytes  # the network, its hash compared
    inputs: tuple[ModelInput, ...]  # what the network takes, and
    features: FeatureSettings  # how that is made
    stream: Mapping[str, tuple[float, float]]  # least and most of each of `_STREAM_KEYS`
    classes: tuple[str, ...]  # order of the network's outputs
    temperature: float  # logits are divided by it
    pet_limit: float  # no alarm above this p(pet) + p(other)
    policy: str  # 'window' or 'fused'
    evidence: Mapping[str, Any]  # how windows are fused, see `EvidenceSettings`
    n_hidden: int = 0  # values that a temporal head hands on to the next window; 0 without one

    @property
    def sha256(self) -> str:
        """Hash of the weights, as the sidecar has it."""
        return hashlib.sha256(self.onnx).hexdigest()

    def takes(self, axis: FastTimeAxis, frame_rate_hz: float) -> bool:
        """Whether it was made for such a stream."""
        return not self._misfits(axis, frame_rate_hz)

    def check_stream(self, axis: FastTimeAxis, frame_rate_hz: float) -> None:
        """Raise ModelMismatch, naming misfits and bundles that fit, unless it takes a stream."""
        misfits = self._misfits(axis, frame_rate_hz)
        if misfits:
            others = [name for name in bundle_names() if name != self.name]
            fit = [name for name in others if load_bundle(name).takes(axis, frame_rate_hz)]
            hint = f"; installed ones that take it: {', '.join(fit)}" if fit else ""
            msg = f"model '{self.name}' does not fit this stream: {'; '.join(misfits)}{hint}"
            raise ModelMismatch(msg)

    def _misfits(self, axis: FastTimeAxis, frame_rate_hz: float) -> list[str]:
        """Say what does not fit; a bandwidth that is not known (0) is not held against it."""
        values = {
            "frame_rate_hz": frame_rate_hz,
            "bin_length_m": axis.bin_length_m,
            "carrier_hz": axis.carrier_hz,
            "bandwidth_hz": axis.bandwidth_hz,
        }
        return [
            f"{key} is {values[key]:.4g}, it takes {low:.4g} to {high:.4g}"
            for key, (low, high) in self.stream.items()
            if not low <= values[key] <= high and not (key == "bandwidth_hz" and values[key] == 0)
        ]


def bundle_names() -> tuple[str, ...]:
    """Return the names of the bundles that came with this installation."""
    folder = resources.files("radard.models")
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".onnx")))


def load_bundle(name: str) -> Bundle:
    """Read a bundle by name, or by the path of its .onnx or .json file.

    Raises BundleError if a file is missing or unreadable, ModelMismatch if the sidecar makes no
    sense or the weights are not those it names.
    """
    if name in bundle_names():
        folder = resources.files("radard.models")
        return _read(
            name, (folder / f"{name}.json").read_bytes, (folder / f"{name}.onnx").read_bytes
        )
    path = Path(name)
    if path.suffix not in {".onnx", ".json"}:
        known = ", ".join(bundle_names()) or "none"
        msg = f"no model '{name}'; {renamed(name)}installed are {known}; a file must end in .onnx"
        raise BundleError(msg)
    return _read(
        path.stem, path.with_suffix(".json").read_bytes, path.with_suffix(".onnx").read_bytes
    )


def _read(name: str, sidecar: Any, weights: Any) -> Bundle:
    try:
        raw = json.loads(sidecar())
        onnx = weights()
    except OSError as err:
        msg = f"model '{name}': cannot read {err.filename}: {err.strerror}"
        raise BundleError(msg) from err
    except (ValueError, RecursionError) as err:
        msg = f"model '{name}': the sidecar is not JSON: {err}"
        raise BundleError(msg) from err
    try:
        return _parse(raw, onnx)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as err:
        msg = f"model '{name}': the sidecar lacks or garbles {str(err)[:_MOST_MESSAGE]}"
        raise ModelMismatch(msg) from err


def _parse(raw: dict[str, Any], onnx: bytes) -> Bundle:
    name = str(raw["name"])
    if raw["schema"] != SCHEMA:
        msg = f"model '{name}': sidecar schema {raw['schema']}, this radard reads {SCHEMA}"
        raise ModelMismatch(msg)
    if hashlib.sha256(onnx).hexdigest() != raw["onnx_sha256"]:
        msg = f"model '{name}': the weights are not those of the sidecar (sha256 differs)"
        raise ModelMismatch(msg)
    if unsafe := unsafe_in(onnx):
        msg = f"model '{name}': the network is refused: {unsafe}"
        raise ModelMismatch(msg)
    classes = tuple(raw["classes"])
    if not {"human", "pet"} <= set(classes) <= set(CLASSES):
        msg = f"model '{name}': classes {classes}; human and pet are needed, other is allowed"
        raise ModelMismatch(msg)
    features = FeatureSettings.from_mapping(raw["features"])
    inputs = tuple(ModelInput(i["name"], tuple(i["shape"]), i["feature"]) for i in raw["inputs"])
    for item in inputs:
        made = feature_shape(item.feature, features)
        if item.shape != made:
            msg = f"model '{name}': input {item.name} is {item.shape}, {item.feature} is {made}"
            raise ModelMismatch(msg)
    stream = {key: (float(low), float(high)) for key, (low, high) in raw["stream"].items()}
    if set(stream) != set(_STREAM_KEYS):
        msg = f"model '{name}': stream needs the keys {', '.join(_STREAM_KEYS)}"
        raise ModelMismatch(msg)
    return Bundle(
        name,
        onnx,
        inputs,
        features,
        stream,
        classes,
        float(raw["temperature"]),
        float(raw["pet_limit"]),
        _policy(raw["policy"]),
        dict(raw.get("evidence", {})),
        _n_hidden(raw.get("hidden", 0)),
    )


def _policy(value: Any) -> str:
    if value not in POLICIES:
        msg = f"policy {value!r}; known are {', '.join(POLICIES)}"
        raise ValueError(msg)
    return str(value)


def _n_hidden(value: Any) -> int:
    if type(value) is not int or not 0 <= value <= _MOST_HIDDEN:
        msg = f"hidden {value!r}; it must be a whole number from 0 to {_MOST_HIDDEN}"
        raise ValueError(msg)
    return value
