"""Model bundle: what a sidecar says, read and checked; and its card, what it says of quality.

NAME.onnx has the weights, NAME.json (the sidecar) says which features go in and for which streams.
"""

import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from radard.config.json_file import LOOSE, STRICT, NotJson, parse_json
from radard.errors import BundleError, ModelMismatch
from radard.judge.features import FeatureSettings, feature_shape
from radard.judge.onnx_safety import unsafe_in
from x2radar.frame import FastTimeAxis

SCHEMA = 1
CLASSES = ("human", "pet", "other")
PROBABILITIES = tuple(f"{of}p_{name}" for of in ("", "fused_") for name in CLASSES)
"""Keys of a decision's record: of its window, and of the evidence so far."""
_MAX_HIDDEN = 4096  # far more than any head here, little enough to keep
_STREAM_KEYS = ("frame_rate_hz", "bin_length_m", "carrier_hz", "bandwidth_hz")
Three = tuple[float | None, float | None, float | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceSettings:
    """How windows are fused; the optional key `evidence` of a bundle's sidecar."""

    __pydantic_config__ = STRICT

    # What a window counts against an independent one; of sums.
    discount: Annotated[float, Field(ge=1e-3, le=1.0)] = 0.6
    # Nats that no class falls further behind the leading one; of sums.
    most: Annotated[float, Field(ge=1.4, le=50.0)] = 5.0
    # Nats added to the log-likelihood of a person.
    prior_human: Annotated[float, Field(ge=-10.0, le=10.0)] = 0.0
    # From this fused p(human) on there is nothing to wait for.
    human_limit: Annotated[float, Field(ge=0.2, le=1.0)] = 0.8
    # Above it undecided evidence waits longer by p(pet) + p(other), less by p(human); 1: never.
    leaning: Annotated[float, Field(ge=0.5, le=1.0)] = 1.0
    # Who leaves undecided before so long is an alarm only if likelier a person than not.
    brief_s: Annotated[float, Field(ge=0.0, le=3.0)] = 0.0

    @classmethod
    def from_mapping(cls, raw: Mapping[str, Any]) -> "EvidenceSettings":
        """Read the settings of a sidecar; raise ModelMismatch on an unknown or wrong one."""
        try:
            return parse_json(cls, json.dumps(raw), "evidence")
        except ValueError as err:
            raise ModelMismatch(str(err)) from err


@dataclass(frozen=True, slots=True)
class ModelInput:
    """One input of the network: its name, its shape without batch, the feature it takes."""

    name: str
    shape: tuple[int, ...]
    feature: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Bundle:
    """A sidecar, read and checked, and the network that it names."""

    __pydantic_config__ = LOOSE

    name: str
    onnx: bytes = b""  # the network, its hash compared
    inputs: tuple[ModelInput, ...]  # what the network takes, and
    features: FeatureSettings  # how that is made
    stream: Mapping[str, tuple[float, float]]  # least and most of each of `_STREAM_KEYS`
    classes: tuple[str, ...]  # order of the network's outputs
    temperature: Annotated[float, Field(gt=0)]  # logits are divided by it
    pet_limit: float  # no alarm above this p(pet) + p(other)
    policy: Literal["window", "fused"]
    evidence: Mapping[str, Any] = field(default_factory=dict)
    """How windows are fused, see `EvidenceSettings`."""
    n_hidden: Annotated[int, Field(ge=0, le=_MAX_HIDDEN, alias="hidden")] = 0
    """Values that a temporal head hands on to the next window; 0 without one."""

    @property
    def sha256(self) -> str:
        """Hash of the weights, as the sidecar has it."""
        return hashlib.sha256(self.onnx).hexdigest()

    @property
    def judges_as(self) -> str:
        """Hash of all that decisions follow from: weights, and what the sidecar says of them."""
        told = (self.temperature, self.pet_limit, self.policy, dict(self.evidence))
        text = json.dumps([self.sha256, asdict(self.features), *told], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

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
        of_axis = {key: getattr(axis, key) for key in _STREAM_KEYS[1:]}
        values = {"frame_rate_hz": frame_rate_hz, **of_axis}
        return [
            f"{key} is {values[key]:.4g}, it takes {low:.4g} to {high:.4g}"
            for key, (low, high) in self.stream.items()
            if not low <= values[key] <= high and not (key == "bandwidth_hz" and values[key] == 0)
        ]


def bundle_names() -> tuple[str, ...]:
    """Return the names of the bundles that came with this installation."""
    folder = resources.files("radard.models")
    return tuple(sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".onnx")))


def sidecar_path(model: str) -> Path:
    """Return where the sidecar of a bundle is, by its name or the path of one of its files."""
    if model in bundle_names():
        return Path(str(resources.files("radard.models") / f"{model}.json"))
    return Path(model).with_suffix(".json")


def load_bundle(name: str) -> Bundle:
    """Read a bundle by name, or its .onnx or .json file; BundleError or ModelMismatch."""
    known = bundle_names()
    if name not in known and Path(name).suffix not in {".onnx", ".json"}:
        msg = f"no model '{name}'; installed are {', '.join(known) or 'none'}"
        raise BundleError(f"{msg}; a file must end in .onnx")
    path = sidecar_path(name)
    name = path.stem
    try:
        return _parse(path.read_bytes(), path.with_suffix(".onnx").read_bytes())
    except OSError as err:
        raise BundleError(f"model '{name}': cannot read {err.filename}: {err.strerror}") from err
    except NotJson as err:
        raise BundleError(f"model '{name}': the sidecar is not JSON: {err}") from err
    except (ValueError, ModelMismatch) as err:
        raise ModelMismatch(f"model '{name}': {err}") from err


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sidecar(Bundle):
    """What is read of NAME.json: all but the network."""

    schema: Literal[1]
    onnx_sha256: str
    classes: tuple[Literal["human", "pet", "other"], ...]


@functools.lru_cache(maxsize=4)  # a hundred radars read the same files
def _parse(sidecar: bytes, onnx: bytes) -> Bundle:
    made = parse_json(_Sidecar, sidecar)
    if hashlib.sha256(onnx).hexdigest() != made.onnx_sha256:
        raise ValueError("the weights are not those of the sidecar (sha256 differs)")
    if unsafe := unsafe_in(onnx):
        raise ValueError(f"the network is refused: {unsafe}")
    if not {"human", "pet"} <= set(made.classes):
        raise ValueError(f"classes {made.classes}; human and pet are needed, other is allowed")
    if set(made.stream) != set(_STREAM_KEYS):
        raise ValueError(f"stream needs the keys {', '.join(_STREAM_KEYS)}")
    EvidenceSettings.from_mapping(made.evidence)
    for item in made.inputs:
        shape = feature_shape(item.feature, made.features)
        if item.shape != shape:
            raise ValueError(f"input {item.name} is {item.shape}, {item.feature} is {shape}")
    return replace(made, onnx=onnx)


@dataclass(frozen=True, slots=True, kw_only=True)
class Passing:
    """How one sensitivity did on whole passages; a `Three` has its 95 % interval's ends."""

    __pydantic_config__ = LOOSE

    intrusions: int  # how many
    missed: Three  # share of them
    half_alarmed_after_s: Three  # from coming in to the alarm; None: so many never alarm
    nine_in_ten_alarmed_after_s: Three  # likewise
    pet_visits: int
    visits_with_alarm: Three  # share of them
    pet_hours: float  # how long the visits last together
    alarms_per_pet_hour: Three  # alarms that began


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """How well a bundle did, in its evaluation and on single windows; for people alone."""

    __pydantic_config__ = LOOSE

    policy: str  # that was evaluated; empty without an evaluation
    command: str  # that evaluated it
    passages: int  # simulated passages of that evaluation
    sensitivities: dict[str, Passing]  # what each made of them
    gate: dict[str, Any] = field(default_factory=dict)  # its settings then; empty: not known
    metrics: dict[str, Any] = field(default_factory=dict)  # of single windows, by name


@dataclass(frozen=True, slots=True)
class _Told:
    """What is read for a card."""

    __pydantic_config__ = LOOSE

    metrics: dict[str, Any] = field(default_factory=dict)
    evaluation: Card | None = None


def read_card(model: str) -> Card:
    """Read the card of a loaded bundle by name or path; ModelMismatch if it is garbled."""
    try:
        found = parse_json(_Told, sidecar_path(model).read_bytes())
    except ValueError as err:
        raise ModelMismatch(f"model '{model}': {err}") from err
    nothing = Card(policy="", command="", passages=0, sensitivities={})
    return replace(found.evaluation or nothing, metrics=found.metrics)
