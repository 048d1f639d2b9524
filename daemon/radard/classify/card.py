"""Card: what a bundle's sidecar says of its quality; for people, nothing is decided by it."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from radard.classify.bundle import bundle_names
from radard.errors import ModelMismatch

Three = tuple[float | None, float | None, float | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Passing:
    """How one sensitivity did on whole passages of people and pets.

    Attributes
    ----------
    intrusions, pet_visits : int
        How many.
    missed, visits_with_alarm : tuple
        Shares of them: value, low and high end of the 95 % interval.
    half_alarmed_after_s, nine_in_ten_alarmed_after_s : tuple
        Time from coming in to the alarm, in seconds; None: so many never alarm.
    pet_hours : float
        How long the visits last together.
    alarms_per_pet_hour : tuple
        Alarms that began.
    """

    intrusions: int
    missed: Three
    half_alarmed_after_s: Three
    nine_in_ten_alarmed_after_s: Three
    pet_visits: int
    visits_with_alarm: Three
    pet_hours: float
    alarms_per_pet_hour: Three


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """Quality of a bundle.

    Attributes
    ----------
    metrics : mapping of str to object
        Of single windows, by name.
    policy, command : str
        Decision policy that was evaluated, and the command; empty without an evaluation.
    passages : int
        Simulated passages of that evaluation.
    sensitivities : mapping of str to Passing
        What each made of them.
    """

    metrics: Mapping[str, Any]
    policy: str = ""
    command: str = ""
    passages: int = 0
    sensitivities: Mapping[str, Passing]


def sidecar_path(model: str) -> Path:
    """Return where the sidecar of a bundle is, by its name or the path of one of its files."""
    if model in bundle_names():
        return Path(str(resources.files("radard.models") / f"{model}.json"))
    return Path(model).with_suffix(".json")


def read_card(model: str) -> Card:
    """Read the card of a bundle that has been loaded, by its name or path.

    Raises
    ------
    ModelMismatch
        If the evaluation in it is garbled.
    """
    raw = json.loads(sidecar_path(model).read_text(encoding="utf-8"))
    metrics = raw.get("metrics", {})
    metrics = metrics if isinstance(metrics, Mapping) else {}
    if "evaluation" not in raw:
        return Card(metrics=metrics, sensitivities={})
    try:
        found = raw["evaluation"]
        return Card(
            metrics=metrics,
            policy=str(found["policy"]),
            command=str(found["command"]),
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
