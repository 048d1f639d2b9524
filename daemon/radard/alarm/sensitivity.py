"""Sensitivities: names over the numbers that turn verdicts into an alarm.

What a name means depends on the decision's policy: fused verdicts have joined the evidence
of several windows already, verdicts of single windows need confirmation.
"""

from dataclasses import asdict
from typing import Any

from radard.alarm.panel import AlarmPolicy
from radard.config.sections import AlarmSection
from radard.judge.bundle import Card, Passing

# Order: k of n, then p_on and p_off of `AlarmPolicy`.
Numbers = tuple[int, int, float, float]
SENSITIVITIES: dict[str, dict[str, Numbers]] = {
    "window": {"low": (3, 5, 0.5, 0.2), "normal": (2, 3, 0.0, 0.1), "high": (1, 1, 0.0, 0.05)},
    "fused": {"low": (2, 3, 0.5, 0.2), "normal": (1, 1, 0.0, 0.1), "high": (1, 1, 0.0, 0.05)},
}
"""By decision policy and name: K of N, least p(human) of a hit, and of still being there."""
_TIMES = ("exit_delay_s", "entry_delay_s", "latch_s", "refractory_s")


def alarm_policy(section: AlarmSection, decision_policy: str) -> AlarmPolicy:
    """Return the numbers that hold: those of the name, but for the ones that were given."""
    k, n, p_on, p_off = SENSITIVITIES[decision_policy][section.sensitivity]
    k = section.confirm_k or min(k, section.confirm_n or k)
    n = section.confirm_n or max(n, k)
    p_on = section.p_on if section.p_on is not None else p_on
    p_off = section.p_off if section.p_off is not None else min(p_off, p_on or p_off)
    times = {name: getattr(section, name) for name in _TIMES}
    return AlarmPolicy(k=k, n=n, p_on=p_on, p_off=p_off, **times)


def sensitivity_choices(
    section: AlarmSection, decision_policy: str, card: Card | None
) -> list[dict[str, Any]]:
    """Return all sensitivities from low to high, as pages have them, and what each costs.

    `policy` are the numbers of a name alone, `made` what they made of simulated passages, by the
    model's card (None: not known), and `costs` says the same to people.
    """
    own = dict.fromkeys(("confirm_k", "confirm_n", "p_on", "p_off"))
    known = card.sensitivities if card is not None and card.policy == decision_policy else {}
    choices = []
    for name in SENSITIVITIES[decision_policy]:
        alone = section.model_copy(update={**own, "sensitivity": name})
        made = known.get(name)
        choice = {"name": name, "is_chosen": name == section.sensitivity}
        choice["policy"] = asdict(alarm_policy(alone, decision_policy))
        choice["made"] = asdict(made) if made is not None else None
        choices.append({**choice, "costs": _costs(made)})
    return choices


def _costs(made: Passing | None) -> str:
    if made is None:
        return "What it costs is not known for this model."
    missed, visits = (
        "?" if share is None else f"{100 * share:.2g} %"
        for share in (made.missed[0], made.visits_with_alarm[0])
    )
    text = f"Misses {missed} of people who come in; {visits} of pets' visits raise an alarm"
    half_s = made.half_alarmed_after_s[0]
    late = f"; half of the alarms come within {half_s:.1f} s" if half_s is not None else ""
    return f"{text}{late} (simulated bodies)."
