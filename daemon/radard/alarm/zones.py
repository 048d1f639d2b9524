"""Zones: the ranges that alarm events heed, and what a decision says of people in them.

A zone is a shell around the sensor. A target counts when it is in an included zone, or none is
named, and in no excluded one; what has no range counts always.
"""

from collections.abc import Iterator
from itertools import pairwise

from radard.alarm.panel import AlarmPolicy, ArmMode, Sight
from radard.config.sections import ZonesSection
from radard.judge.decision import Decision, judge

_SLACK_M = 0.2  # a zone is drawn by hand


def armed_zones(zones: ZonesSection, mode: ArmMode) -> ZonesSection:
    """Return the zones that hold while the sensor is so armed."""
    exclude = (*zones.exclude, *zones.away) if mode == "home" else zones.exclude
    return ZonesSection.model_construct(include=zones.include, exclude=exclude, away=())


def heeds(zones: ZonesSection, range_m: float) -> bool:
    """Return whether a target at a range counts."""
    is_in = not zones.include or any(a <= range_m <= b for a, b in zones.include)
    return is_in and not any(a <= range_m <= b for a, b in zones.exclude)


def zone_fault(zones: ZonesSection, near_m: float, far_m: float) -> str:
    """Return what is wrong if no range of a swath counts, so that nobody could raise an alarm."""
    edges_m = sorted({near_m, far_m, *(m for s in (*zones.include, *zones.exclude) for m in s)})
    inside_m = [m for m in edges_m if near_m <= m <= far_m]
    middles_m = [(a + b) / 2 for a, b in pairwise(inside_m)]
    if any(heeds(zones, m) for m in middles_m):
        if not zones.away:
            return ""
        fault = zone_fault(armed_zones(zones, "home"), near_m, far_m)
        return f"{fault}, while armed at home" if fault else ""
    return f"zones: nothing counts within the sensor's swath, {near_m:.2f} to {far_m:.2f} m"


def zone_warnings(zones: ZonesSection, near_m: float, far_m: float) -> Iterator[str]:
    """Yield which included zones reach beyond a swath."""
    for start_m, end_m in zones.include:
        if start_m < near_m - _SLACK_M or end_m > far_m + _SLACK_M:
            yield (
                f"zones.include: {start_m:g} to {end_m:g} m reaches beyond the sensor's swath, "
                f"{near_m:.2f} to {far_m:.2f} m: there nobody is seen"
            )


def sight_of(
    decision: Decision, policy: AlarmPolicy, zones: ZonesSection, pet_limit: float
) -> Sight:
    """Return what a valid decision means for the alarm, by the rule's `pet_limit`.

    A verdict is a hit from p(human) `p_on` on; one that stands on other grounds (undecided too
    long, like nothing known) is a hit whatever its p(human). The reason names the nearest body
    that counts.
    """
    p_human = decision.fused.human if decision.fused else 0.0
    by_rule = decision.fused is not None and p_human >= 1 - pet_limit - 1e-9
    where = _nearest_heeded(decision, zones, pet_limit)
    is_heeded = where is not None
    is_hit = decision.alarm and is_heeded and (not by_rule or p_human >= policy.p_on)
    may_be = decision.alarm or decision.label == "pending" or p_human > policy.p_off
    is_seen = is_hit or (is_heeded and may_be)
    place = f" at {where:.1f} m" if where is not None and where >= 0 else ""
    who, waited_s = str(decision.label), decision.undecided_s
    if waited_s is not None:
        who = f"undecided for {waited_s:.0f} s" if waited_s >= 0.5 else "undecided"
    return Sight(is_hit, is_seen, f"{who}{place}")


def _nearest_heeded(decision: Decision, zones: ZonesSection, pet_limit: float) -> float | None:
    """Return the range of the nearest suspect that counts, -1 when it has none, else None.

    Suspects are tracks that are not taken for pets, else what is at the one range.
    """
    ranges = [
        track.range_m
        for track in decision.tracks
        if track.window is None or judge(track.window, pet_limit)[1]
    ]
    if not ranges and decision.reading is not None:
        ranges = [decision.reading.range_m]
    return min((r for r in ranges if heeds(zones, r)), default=None) if ranges else -1.0
