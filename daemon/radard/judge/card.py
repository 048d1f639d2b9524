"""Card: what a bundle's sidecar says of its quality; for people, nothing is decided by it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from radard.errors import ModelMismatch
from radard.judge.bundle import bundle_names

Three = tuple[float | None, float | None, float | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Passing:
    """How one sensitivity did on whole passages of people and pets.

    A `Three` is a value with the low and high end of its 95 % interval.
    """

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
    """Quality of a bundle."""

    metrics: Mapping[str, Any]  # of single windows, by name
    policy: str = ""  # that was evaluated; empty without an evaluation
    command: str = ""  # that evaluated it
    gate: Mapping[str, Any]  # its settings in that evaluation; empty where not known
    passages: int = 0  # simulated passages of that evaluation
    sensitivities: Mapping[str, Passing]  # what each made of them


def sidecar_path(model: str) -> Path:
    """Return where the sidecar of a bundle is, by its name or the path of one of its files."""
    if model in bundle_names():
        return Path(str(resources.files("radard.models") / f"{model}.json"))
    return Path(model).with_suffix(".json")


def read_card(model: str) -> Card:
    """Read the card of a loaded bundle by name or path; ModelMismatch if it is garbled."""
    raw = json.loads(sidecar_path(model).read_text(encoding="utf-8"))
    metrics = raw.get("metrics", {})
    metrics = metrics if isinstance(metrics, Mapping) else {}
    if "evaluation" not in raw:
        return Card(metrics=metrics, gate={}, sensitivities={})
    try:
        found = raw["evaluation"]
        return Card(
            metrics=metrics,
            policy=str(found["policy"]),
            command=str(found["command"]),
            gate=dict(found.get("gate", {})),
            passages=int(found["passages"]),
            sensitivities={n: _passing(p) for n, p in found["sensitivities"].items()},
        )
    except (KeyError, TypeError, ValueError, AttributeError) as err:
        msg = f"model '{model}': the sidecar's evaluation lacks or garbles {err}"
        raise ModelMismatch(msg) from err


def _passing(raw: Mapping[str, Any]) -> Passing:
    return Passing(
        intrusions=int(raw["intrusions"]),
        missed=_three(raw["missed"]),
        half_alarmed_after_s=_three(raw["half_alarmed_after_s"]),
        nine_in_ten_alarmed_after_s=_three(raw["nine_in_ten_alarmed_after_s"]),
        pet_visits=int(raw["pet_visits"]),
        visits_with_alarm=_three(raw["visits_with_alarm"]),
        pet_hours=float(raw["pet_hours"]),
        alarms_per_pet_hour=_three(raw["alarms_per_pet_hour"]),
    )


def _three(raw: Any) -> Three:
    value, low, high = (None if v is None else float(v) for v in raw)
    return value, low, high
