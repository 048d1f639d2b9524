"""Why an alarm came, or did not: a decision in words, stage by stage, up to the one that decided.

All stages that may stop an alarm stand here in their order. The words are made of the decision's
record and those before it, by the functions of the alarm itself, so that they agree with it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from typing import Any

from radard.alarm.panel import AlarmPolicy
from radard.alarm.sensitivity import alarm_policy
from radard.alarm.sensor_state import SensorState
from radard.alarm.zones import armed_zones, sight_of
from radard.config.config import Config
from radard.config.quiet_hours import QuietHours, parse_quiet, recorded_clock, time_zone
from radard.config.sections import ZonesSection
from radard.detect.gate import GateReading
from radard.judge.classifier import Probabilities
from radard.judge.decision import MIN_P, Decision, TrackVerdict
from radard.log import Record

Stage = dict[str, str]
_WORDS = {"human": "person", "pet": "pet", "other": "something else"}


def _stage(outcome: str, name: str, text: str, plain: str) -> Stage:
    """Return one stage of a decision: `text` has the numbers, `plain` the same for people."""
    return {"outcome": outcome, "name": name, "text": text, "plain": plain}


_passed, _decided = partial(_stage, "passed"), partial(_stage, "decided")


def explain(
    records: Sequence[Record],
    hello: Record,
    config: Config,
    events: Sequence[Record] = (),
    state: SensorState | None = None,
) -> dict[str, Any]:
    """Return seq, t_s, headline, decided_by and stages of the last of `records`."""
    record = records[-1]
    state = state or SensorState()
    limit = hello.get("pet_limit", 0.8)
    policy = alarm_policy(config.alarm, hello.get("policy", "window"))
    stages = [_frames(record, events)]
    if record["gate"] != "invalid":
        # Windows that nobody can judge end no visit.
        judged = [r["label"] for r in records[:-1] if r["gate"] != "invalid"]
        stages.append(_gate(record, was_pending=judged[-1:] == ["pending"]))
    if record["gate"] == "open":
        stages += _classified(record, limit)
    if record["alarm"]:
        zones = armed_zones(config.zones, state.mode)
        hits = [_is_hit(r, policy, zones, limit) for r in records[-policy.n :]]
        alarms = [e for e in events if e["kind"] == "alarm"]
        at: datetime | None = datetime.fromisoformat(record["time"])
        if hello.get("replayed"):
            at = recorded_clock(hello.get("started_utc") or "")(record["t_s"])
        stages += _confirmed(hits, _Panel(record, policy, alarms, state, config, at))
    by = next((s for s in reversed(stages) if s["outcome"] == "decided"), stages[-1])
    return {
        "seq": record["seq"],
        "t_s": record["t_s"],
        "headline": _headline(record, by),
        "decided_by": by["name"],
        "stages": stages,
    }


def _frames(record: Record, events: Sequence[Record]) -> Stage:
    n, lost = record["frames"], record["dropped"]
    if record["gate"] != "invalid":
        missing = f"{lost} missing, few enough" if lost else "none missing"
        plain = "All but a little arrived." if lost else "Everything arrived."
        return _passed("frames", f"{n + lost} frames in the window, {missing}.", plain)
    if lost:
        text = (
            f"The window is invalid because of a gap: {lost} of {n + lost} frames are missing. "
            "At most 2 % may be, and no gap longer than 50 ms."
        )
        return _decided("frames", text, "Too much got lost between the sensor and this machine.")
    at_s = record["t_s"]
    reasons = (e["reason"] for e in events if e["kind"] == "fault" and _covers(e, at_s))
    reason = next(reasons, "its frames could not be used")
    return _decided("frames", f"The window is invalid: {reason}.", f"No: {reason}.")


def _gate(record: Record, *, was_pending: bool) -> Stage:
    power, threshold = record["power_db"], record["threshold_db"]
    apart = f"{abs(power - threshold):.1f} dB"
    closed = f"The gate has closed ({_db(power)}, {apart} under the threshold)"
    if record["gate"] == "closed" and record["alarm"]:
        text = f"{closed}, and what was there left undecided: that counts as human."
        return _passed("gate", text, "Yes: it left undecided, and that counts as a person.")
    if record["gate"] == "closed" and was_pending:
        brief = "showed but briefly, and was less likely a person than not"
        text = f"{closed}. What was there {brief}: it is passed over."
        return _decided("gate", text, f"No: it {brief}.")
    if record["gate"] == "closed":
        text = (
            f"The gate is closed: what moves has {_db(power)}, {apart} under the threshold of "
            f"{_db(threshold)}. Nobody is there, or nobody moves."
        )
        return _decided("gate", text, "No: nobody is there, or nobody moves.")
    text = f"The gate is open: {_db(power)} is {apart} over the threshold of {_db(threshold)}"
    where = f", most of it at {record['range_m']:.1f} m." if record["range_m"] is not None else "."
    times = 10 ** ((power - threshold) / 10)
    much = "over 1000" if times > 1000 else f"{times:.{1 if times < 10 else 0}f}"
    plain = f"Yes, {much} times as much as must be there to count{where}"
    return _passed("gate", text + where, plain)


def _classified(record: Record, limit: float) -> list[Stage]:
    if record["p_human"] is None:
        text = "No model is loaded: the gate works alone, and there is no verdict."
        plain = "Nobody can say: no network is loaded, only movement is noticed."
        return [_decided("classifier", text, plain)]
    own = {key: record[f"p_{key}"] for key in _WORDS}
    fused = {key: record[f"fused_p_{key}"] for key in _WORDS}
    shown = [key for key in own if key != "other" or own[key]]
    shares = ", ".join(f"{key} {own[key]:.2f}" for key in shown)
    stages = [_passed("classifier", f"The network says: {shares}.", f"{_plain(own)}.")]
    if fused != own:
        text = f"With the windows before it: human {fused['human']:.2f}, pet {fused['pet']:.2f}."
        stages.append(_passed("evidence", text, f"{_plain(fused)}."))
    return [*stages, _rule(record, fused["pet"] + fused["other"], limit)]


def _plain(shares: Mapping[str, float]) -> str:
    text = ", ".join(
        f"{word} {100 * shares[key]:.0f} %"
        for key, word in _WORDS.items()
        if key != "other" or round(100 * shares[key])
    )
    return text[:1].upper() + text[1:]


def _rule(record: Record, harmless: float, limit: float) -> Stage:
    name = "p(pet) + p(other)" if record["fused_p_other"] else "p(pet)"
    share = f"{100 * harmless:.0f} %"
    if record["label"] == "pending":
        text = f"Undecided: {name} {harmless:.2f}, and neither side is sure yet."
        plain = f"Not clear yet: {share} harmless, and neither side is sure."
        more = "It goes on looking."
        return _decided("rule", f"{text} {more}", f"{plain} {more}")
    if not record["alarm"]:
        what = "a pet" if record["label"] == "pet" else "a harmless thing"
        text = f"{name} {harmless:.2f} > {limit:.2f}: {what}, no alarm."
        plain = f"No: {share} sure that it is {what}, more than {100 * limit:.0f} %."
        return _decided("rule", text, plain)
    if harmless > limit:
        text = f"{name} is {harmless:.2f}, but it resembles nothing known: that counts as human."
        plain = "Yes: it resembles nothing known, and that counts as a person."
        return _passed("rule", text, plain)
    text = f"{name} {harmless:.2f} ≤ {limit:.2f}: not surely a pet, so it counts as human."
    plain = f"Yes: only {share} harmless. Unless it is surely a pet, it counts as a person."
    return _passed("rule", text, plain)


@dataclass(frozen=True, slots=True)
class _Panel:
    """The panel as it took a decision."""

    record: Record
    policy: AlarmPolicy
    alarms: Sequence[Record]
    state: SensorState  # just before
    config: Config
    at: datetime | None  # the clock on the wall, of the stream


def _confirmed(hits: Sequence[bool], panel: _Panel) -> list[Stage]:
    if not hits[-1]:
        where = "It does not count towards an alarm: it is outside of the zones, or"
        text = f"{where} p(human) is under {panel.policy.p_on:.2f}."
        plain = f"{where} less than {100 * panel.policy.p_on:.0f} % a person."
        return [_decided("zones", text, plain)]
    return [_passed("zones", "It is where it counts.", "Yes."), _panel_stage(sum(hits), panel)]


def _panel_stage(n_hits: int, panel: _Panel) -> Stage:
    policy, t_s = panel.policy, panel.record["t_s"]
    says, need = ("says" if n_hits == 1 else "say"), ("is" if policy.k == 1 else "are")
    counted = f"{n_hits} of the last {policy.n} windows {says} human; {policy.k} {need} needed"
    plain = f"{n_hits} of the last {policy.n} decisions {says} person; {policy.k} must"
    if policy.n == 1:
        counted, plain = "this window says human, and one is enough", "Once is enough"
    alarm = next((e for e in panel.alarms if _covers(e, t_s)), None)
    if alarm is not None and alarm["start_t_s"] == t_s:
        began = "The alarm began here."
        return _decided("confirmation", f"Confirmed: {counted}. {began}", f"{plain}. {began}")
    if alarm is not None:
        cause = alarm.get("cause", alarm["reason"])
        on = "The alarm is on already"
        return _decided("panel", f"{on} ({cause}).", f"{on}.")
    if n_hits < policy.k and panel.state.panel in {"armed", "entry"}:
        return _decided("confirmation", f"Not confirmed yet: {counted}.", f"Not yet: {plain}.")
    text = f"{counted}, but {_held_by(panel)}"
    return _decided("panel", text[:1].upper() + text[1:], f"{plain}, but {_held_by(panel)}")


def _held_by(panel: _Panel) -> str:
    """Return the one thing that keeps a confirmed person from being an alarm."""
    t_s, state, policy = panel.record["t_s"], panel.state, panel.policy
    left = _seconds((state.delay_left_s or 0.0) - max(0.0, t_s - state.t_s))
    if state.panel == "disarmed":
        return "the sensor is disarmed: nobody is told."
    if state.panel == "exit":
        return f"the exit delay is running: {left} left, and nobody is told."
    if state.panel == "entry":
        return f"the entry delay is running: {left} left to disarm."
    ends_s = (e["end_t_s"] for e in panel.alarms if e["end_t_s"] is not None)
    last_s = max((end_s for end_s in ends_s if end_s <= t_s), default=-math.inf)
    if (pause_s := last_s + policy.refractory_s - t_s) > 0:
        return f"it is the pause after the last alarm: {_seconds(pause_s)} left."
    if quiet := _quiet_left(panel):
        return f"it is a quiet period: {quiet} left."
    if policy.entry_delay_s:
        return f"the entry delay begins here: {_seconds(policy.entry_delay_s)} to disarm."
    return "it counts from when it was armed, or from the last alarm's end."


def _quiet_left(panel: _Panel) -> str:
    """Return how much is left of a quiet period at the time of a decision; empty outside one."""
    alarm, at = panel.config.alarm, panel.at
    if at is None:
        return ""
    periods = [parse_quiet(text) for text in alarm.quiet]
    hours = QuietHours(periods, time_zone(alarm.timezone), lambda s: at + timedelta(seconds=s))
    whole = range(0, 7 * 86_400, 60)
    left = next((s for s in whole if not hours.holds(s)), whole.stop)
    return f"{left // 3600} h {left // 60 % 60} min" if left else ""


def _seconds(value: float) -> str:
    return f"{max(0.0, value):.0f} s"


def _db(value: float) -> str:
    return f"{value:.1f} dB".replace("-", "\N{MINUS SIGN}")


def _covers(event: Record, t_s: float) -> bool:
    end_s = event["end_t_s"]
    return bool(event["start_t_s"] <= t_s and (end_s is None or t_s <= end_s))


def _headline(record: Record, by: Stage) -> str:
    if record["gate"] == "invalid":
        return "This window could not be judged"
    if record["gate"] == "closed" and not record["alarm"]:
        return "Nothing moves"
    if record["label"] is None:
        return "Something moves; there is no model to say what"
    if record["label"] == "pending":
        return "Not decided yet"
    if not record["alarm"]:
        return "A pet" if record["label"] == "pet" else "Something harmless"
    who = "A person" if (record["fused_p_human"] or 0) >= MIN_P else "Undecided"
    is_new = by["name"] == "confirmation" and by["text"].startswith("Confirmed")
    return f"{who}: alarm" if is_new else who


def _is_hit(record: Record, policy: AlarmPolicy, zones: ZonesSection, limit: float) -> bool:
    """Return whether a record's decision counts, by what `sight_of` heeds of it."""
    if record["gate"] == "invalid":
        return False
    about = ("id", "range_m", "radial_velocity_mps")
    tracks = tuple(
        TrackVerdict(**{name: t[name] for name in about}, window=_probabilities(t, "p_"))
        for t in record["tracks"]
    )
    decision = Decision(
        **{n: record[n] for n in ("seq", "t_s", "gate", "label", "alarm", "frames", "dropped")},
        reading=GateReading(True, 0.0, 0.0, 0.0, record["range_m"] or 0.0),
        fused=_probabilities(record, "fused_p_"),
        tracks=tracks,
    )
    return sight_of(decision, policy, zones, limit).is_hit


def _probabilities(record: Record, prefix: str) -> Probabilities | None:
    human, pet, other = (record[prefix + name] for name in ("human", "pet", "other"))
    return None if human is None else Probabilities(human, pet, other)
