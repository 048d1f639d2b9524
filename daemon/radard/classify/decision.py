"""Decision: gate and probabilities become a label and the alarm.

The rule: with the gate open, alarm unless p_pet + p_other > pet_limit and one of the two is
at least a half. `other` are trained harmless motions only; motion that resembles nothing, or
a bit of everything, counts as human. Policy `window` applies the rule to each window alone
(the thesis' rule). Policy `fused` applies it to the evidence over windows
(`radard.classify.evidence`), and waits while that is undecided, for a few seconds at most.
"""

from dataclasses import dataclass
from typing import Literal

from radard.classify.classifier import Probabilities
from radard.detect.gate import GateReading
from radard.stream.ring import Dwell

Label = Literal["human", "pet", "other", "pending", "none", "invalid"]
GateState = Literal["open", "closed", "invalid"]
LEAST_P = 0.5
"""No class below it is what moves."""
_ROUNDING_S = 0.07
"""More than a frame of the slowest stream that a bundle takes (14.5 Hz), far less than a hop."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackVerdict:
    """One body, judged by itself: by what moves within its own range gate.

    Attributes
    ----------
    id : int
        Number of the track.
    range_m, radial_velocity_mps : float
        At the end of the dwell; approaching is positive.
    window : Probabilities or None
        Of this window; None without a model.
    """

    id: int
    range_m: float
    radial_velocity_mps: float
    window: Probabilities | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """What was decided on one dwell.

    Attributes
    ----------
    seq : int
        Number of the decision, from 1.
    t_s : float
        Stream time at the end of the dwell, in seconds.
    gate : {'open', 'closed', 'invalid'}
        Whether something moves; invalid when too many frames are missing.
    reading : GateReading or None
        Powers and range; None when invalid.
    window, fused : Probabilities or None
        Of this window, and of the evidence over windows; None unless the gate is open and
        a model is loaded.
    label : str or None
        Who moves; None without a model while the gate is open.
    alarm : bool
        The verdict of this decision.
    frames, dropped : int
        Frames in the dwell and frames missing in it.
    tracks : tuple of TrackVerdict
        Bodies that are followed; none while the gate is closed.
    fault : str
        Why the window is invalid; empty otherwise.
    t_mono_s : float
        When the dwell's last frame arrived, on the host's monotonic clock.
    """

    seq: int
    t_s: float
    gate: GateState
    reading: GateReading | None
    window: Probabilities | None
    fused: Probabilities | None
    label: Label | None
    alarm: bool
    frames: int
    dropped: int
    tracks: tuple[TrackVerdict, ...] = ()
    fault: str = ""
    t_mono_s: float = 0.0


def invalid_decision(dwell: Dwell, fault: str, *, seq: int = 0) -> Decision:
    """Return the decision on a dwell that cannot be judged: no probabilities, no alarm."""
    return Decision(
        seq=seq,
        t_s=dwell.t_s,
        gate="invalid",
        reading=None,
        window=None,
        fused=None,
        label="invalid",
        alarm=False,
        frames=len(dwell.frames) - dwell.n_lost,
        dropped=dwell.n_lost,
        fault=fault,
        t_mono_s=dwell.t_mono_s,
    )


def judge(p: Probabilities, pet_limit: float) -> tuple[Label, bool]:
    """Apply the rule to one set of probabilities.

    Parameters
    ----------
    p : Probabilities
        Of one window, or fused.
    pet_limit : float
        Probability of pet and other together above which there is no alarm, if one of the
        two is at least a half.

    Returns
    -------
    label : {'human', 'pet', 'other'}
        Human whenever the alarm is on.
    alarm : bool
        The verdict.
    """
    if p.pet + p.other > pet_limit and max(p.pet, p.other) >= LEAST_P:
        return ("pet" if p.pet >= p.other else "other"), False
    return "human", True


class Verdict:
    """The rule over time: policy `fused`.

    Parameters
    ----------
    pet_limit : float
        As in `judge`.
    human_limit : float
        From this fused probability of a person on the alarm does not wait.
    decide_within_s : float
        So long after the gate has opened the alarm waits for evidence, in seconds.
    """

    def __init__(self, pet_limit: float, human_limit: float, decide_within_s: float) -> None:
        self._pet_limit = pet_limit
        self._human_limit = human_limit
        self._within_s = decide_within_s
        self._since_s: float | None = None
        self._is_pending = False

    def reset(self) -> None:
        """Forget who was there."""
        self._since_s = None
        self._is_pending = False

    def judge(self, fused: Probabilities, t_s: float) -> tuple[Label, bool]:
        """Apply the rule to fused probabilities while the gate is open.

        Parameters
        ----------
        fused : Probabilities
            Of everything since the gate has opened.
        t_s : float
            Stream time of the decision, in seconds.

        Returns
        -------
        label : {'human', 'pet', 'other', 'pending'}
            Human whenever the alarm is on.
        alarm : bool
            The verdict.
        """
        if self._since_s is None:
            self._since_s = t_s
        label, alarm = judge(fused, self._pet_limit)
        # Dwells end at whole frames, so three hops may last a little less than 3 s.
        may_wait = t_s - self._since_s < self._within_s - _ROUNDING_S
        self._is_pending = alarm and may_wait and fused.human < self._human_limit
        return ("pending", False) if self._is_pending else (label, alarm)

    def leave(self) -> bool:
        """Take note that the gate has closed; return whether somebody left undecided."""
        was_pending = self._is_pending
        self.reset()
        return was_pending
