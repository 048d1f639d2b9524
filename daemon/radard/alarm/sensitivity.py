"""Sensitivities: names over the numbers that turn verdicts into an alarm.

What a name means depends on the decision's policy: fused verdicts have joined the evidence
of several windows already, verdicts of single windows need confirmation.
"""

from radard.alarm.panel import AlarmPolicy
from radard.config.sections import AlarmSection

# Order: k of n, then p_on and p_off of `AlarmPolicy`.
Numbers = tuple[int, int, float, float]
SENSITIVITIES: dict[str, dict[str, Numbers]] = {
    "window": {
        "low": (3, 5, 0.5, 0.2),
        "normal": (2, 3, 0.0, 0.1),
        "high": (1, 1, 0.0, 0.05),
    },
    "fused": {
        "low": (2, 3, 0.5, 0.2),
        "normal": (1, 1, 0.0, 0.1),
        "high": (1, 1, 0.0, 0.05),
    },
}
"""By decision policy and name: K of N, least p(human) of a hit, p(human) of still being there.
Chosen; what they cost is measured on passages and told by `radard explain`."""


def alarm_policy(section: AlarmSection, decision_policy: str) -> AlarmPolicy:
    """Return the numbers that hold: those of the name, but for the ones that were given.

    `decision_policy` is 'window' or 'fused'.
    """
    k, n, p_on, p_off = SENSITIVITIES[decision_policy][section.sensitivity]
    k = section.confirm_k or min(k, section.confirm_n or k)
    n = section.confirm_n or max(n, k)
    p_on = section.p_on if section.p_on is not None else p_on
    p_off = section.p_off if section.p_off is not None else min(p_off, p_on or p_off)
    return AlarmPolicy(
        k=k,
        n=n,
        p_on=p_on,
        p_off=p_off,
        exit_delay_s=section.exit_delay_s,
        entry_delay_s=section.entry_delay_s,
        latch_s=section.latch_s,
        refractory_s=section.refractory_s,
    )
