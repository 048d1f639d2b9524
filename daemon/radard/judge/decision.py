"""Decision: gate and probabilities become a label and the alarm, by the rule of `judge`.

`other` are trained harmless motions only; motion that resembles nothing, or a bit of everything,
counts as human. Policy `window` applies the rule to each window alone (the thesis' rule), policy
`fused` to the evidence over windows (`radard.judge.evidence`), while that is decided (`Verdict`).
"""

from dataclasses import dataclass
from typing import Literal

from radard.config.config import Config
from radard.detect.gate import GateReading
from radard.detect.tamper import Finding
from radard.judge.bundle import Bundle, EvidenceSettings
from radard.judge.classifier import Probabilities
from radard.stream.ring import Dwell

Label = Literal["human", "pet", "other", "pending", "none", "invalid"]
GateState = Literal["open", "closed", "invalid"]
MIN_P = 0.5  # no class below it is what moves
LONGER, SHORTER = 2.5, 2 / 3  # that evidence that leans to a pet, or a person, waits against even
_OF_WINDOWS = EvidenceSettings(human_limit=MIN_P)  # policy 'window': nothing to wait for
HIGH_PET_LIMIT = 0.9  # least at sensitivity 'high' under policy 'fused' (docs/evaluation.md)
_STILL = 0.96  # p(pet) + p(other) above which what was known for harmless is so still
_ROUNDING_S = 0.07  # more than a frame of the slowest stream that a bundle takes (14.5 Hz)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackVerdict:
    """One body, judged by itself: by what moves within its own range gate."""

    id: int  # number of the track
    range_m: float  # at the end of the dwell
    radial_velocity_mps: float  # likewise; approaching is positive
    window: Probabilities | None  # of this window; None where nothing judged it by itself


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Result of one dwell: gate, probabilities, label and alarm."""

    seq: int  # from 1
    t_s: float  # stream time at the end of the dwell
    gate: GateState  # whether something moves; invalid: too many frames are missing
    reading: GateReading | None = None  # powers and range; None when invalid
    window: Probabilities | None = None  # of this window; None without a model or motion
    fused: Probabilities | None = None  # of the evidence over windows, likewise
    label: Label | None  # who moves; None without a model while the gate is open
    alarm: bool = False  # the verdict of this decision
    frames: int  # in the dwell
    dropped: int  # missing in it
    tracks: tuple[TrackVerdict, ...] = ()  # none while the gate is closed
    undecided_s: float | None = None  # how long evidence was awaited; None where it decided
    fault: str = ""  # why the window is invalid, or what is wrong with one that was judged
    findings: tuple[Finding, ...] = ()  # tamper that holds now; empty when it is not looked for
    t_mono_s: float = 0.0  # when the dwell's last frame arrived, on the host's monotonic clock


def invalid_decision(dwell: Dwell, fault: str, *, seq: int = 0) -> Decision:
    """Return the decision on a dwell that cannot be judged: no probabilities, no alarm."""
    return Decision(
        seq=seq,
        t_s=dwell.t_s,
        gate="invalid",
        label="invalid",
        frames=len(dwell.frames) - dwell.n_lost,
        dropped=dwell.n_lost,
        fault=fault,
        t_mono_s=dwell.t_mono_s,
    )


def judge(p: Probabilities, pet_limit: float, least: float = MIN_P) -> tuple[Label, bool]:
    """Apply the rule to the probabilities of one window, or fused ones: the label and the alarm.

    Gate open, alarm unless p(pet) + p(other) is above `pet_limit` and one of the two at least
    `least`, a half. The label is human whenever the alarm is on.

    >>> judge(Probabilities(human=0.1, pet=0.85, other=0.05), pet_limit=0.8)
    ('pet', False)

    Motion that resembles nothing counts as human:

    >>> judge(Probabilities(human=0.1, pet=0.45, other=0.45), pet_limit=0.8)
    ('human', True)
    """
    if p.pet + p.other > pet_limit and max(p.pet, p.other) >= least:
        return ("pet" if p.pet >= p.other else "other"), False
    return "human", True


class Verdict:
    """The rule over time, by the `pet_limit` of `judge`.

    From p(human) `human_limit` on the alarm does not wait; else it waits for evidence for
    `decide_within_s` after the gate has opened, 0 under policy `window`; `LONGER` of it while
    p(pet) + p(other) is above `leaning`, and one of them at least a half, `SHORTER` of it while
    p(human) is. What was known for a pet or a thing since the gate opened is harmless still while
    p(pet) + p(other) is above `_STILL`, even if neither is a half: that it seems a bit of both
    speaks for no person. Who leaves undecided is an alarm too; sooner than `brief_s`, only who is
    likelier a person than not, unless `pet_limit` is as high as sensitivity 'high' has it.
    `undecided_s` is for how long neither side has been reached, by the last call; None where one
    has, or an alarm that waits no more is for somebody who is likelier a person than not.
    """

    def __init__(
        self,
        pet_limit: float,
        settings: EvidenceSettings = _OF_WINDOWS,
        decide_within_s: float = 0.0,
    ) -> None:
        self.pet_limit = pet_limit
        self._settings = settings
        self._within_s = decide_within_s
        self.reset()

    def reset(self) -> None:
        """Forget who was there."""
        self._since_s: float | None = None
        self._unsure_since_s: float | None = None
        self._is_pending = False
        self._may_leave = False
        self._is_known = False
        self.undecided_s: float | None = None

    def judge(self, p: Probabilities, t_s: float) -> tuple[Label, bool]:
        """Apply the rule, gate open, to one window or what was fused since it opened."""
        if self._since_s is None:
            self._since_s = t_s
        label, alarm = judge(p, self.pet_limit)
        if self._is_known and alarm:
            label, alarm = judge(p, max(self.pet_limit, _STILL), least=0.0)
        # Policy 'window' has no windows before this one.
        self._is_known |= self._within_s > 0 and not alarm
        is_unsure = alarm and p.human < self._settings.human_limit
        if is_unsure and self._unsure_since_s is None:
            self._unsure_since_s = t_s
        elif not is_unsure:
            self._unsure_since_s = None
        # Dwells end at whole frames, so three hops may last a little less than 3 s.
        there_s = t_s - self._since_s + _ROUNDING_S
        leans = p.pet + p.other > self._settings.leaning and max(p.pet, p.other) >= MIN_P
        share = LONGER if leans else SHORTER if p.human > self._settings.leaning else 1.0
        self._is_pending = is_unsure and there_s < self._within_s * share
        is_brief = there_s < self._settings.brief_s and self.pet_limit < HIGH_PET_LIMIT
        self._may_leave = is_brief and p.human < MIN_P
        is_likely = p.human >= MIN_P and not self._is_pending
        since_s = self._unsure_since_s
        self.undecided_s = None if since_s is None or is_likely else t_s - since_s
        return ("pending", False) if self._is_pending else (label, alarm)

    def leave(self) -> bool:
        """Take note that the gate has closed; return whether who left undecided is an alarm."""
        is_alarm, undecided_s = self._is_pending and not self._may_leave, self.undecided_s
        self.reset()
        self.undecided_s = undecided_s if is_alarm else None
        return is_alarm


def policy_of(config: Config, bundle: Bundle | None) -> str:
    """Return the policy that holds: the one given, else the bundle's; 'window' without either."""
    return config.decision.policy or (bundle.policy if bundle else "window")


def pet_limit_of(config: Config, bundle: Bundle | None) -> float:
    """Return the pet limit that holds: the one given, else the bundle's."""
    if config.decision.pet_limit:
        return config.decision.pet_limit
    limit = bundle.pet_limit if bundle else 0.8
    # A single fused verdict is an alarm already: a higher limit is all that 'high' can ask for.
    is_high = policy_of(config, bundle) == "fused" and config.alarm.sensitivity == "high"
    return max(limit, HIGH_PET_LIMIT) if is_high else limit
