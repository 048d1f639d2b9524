"""Card: what a bundle's sidecar says of its quality; for people, nothing is decided by it."""

from dataclasses import dataclass, field, replace
from typing import Any

from radard.config.json_file import LOOSE, parse_json
from radard.errors import ModelMismatch
from radard.judge.bundle import sidecar_path

Three = tuple[float | None, float | None, float | None]


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
    """How well a bundle did, in its evaluation and on single windows."""

    __pydantic_config__ = LOOSE

    policy: str  # that was evaluated; empty without an evaluation
    command: str  # that evaluated it
    passages: int  # simulated passages of that evaluation
    sensitivities: dict[str, Passing]  # what each made of them
    gate: dict[str, Any] = field(default_factory=dict)  # its settings then; empty: not known
    metrics: dict[str, Any] = field(default_factory=dict)  # of single windows, by name


def read_card(model: str) -> Card:
    """Read the card of a loaded bundle by name or path; ModelMismatch if it is garbled."""
    try:
        found = parse_json(_Sidecar, sidecar_path(model).read_bytes())
    except ValueError as err:
        raise ModelMismatch(f"model '{model}': {err}") from err
    nothing = Card(policy="", command="", passages=0, sensitivities={})
    return replace(found.evaluation or nothing, metrics=found.metrics)


@dataclass(frozen=True, slots=True)
class _Sidecar:
    """What a card reads of a sidecar."""

    __pydantic_config__ = LOOSE

    metrics: dict[str, Any] = field(default_factory=dict)
    evaluation: Card | None = None
