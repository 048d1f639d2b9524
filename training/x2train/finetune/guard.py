"""Guard: simulated people whom no finetuning may hide, and how many of them are missed.

Missed is counted twice over: in windows, taken alone, which the rule would keep quiet, and in
passages without any alarm by the bundle's own policy. Both rises must stay within the bound.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.config.sections import DecisionSection
from radard.errors import UsageError
from radard.judge.bundle import CLASSES, Bundle, EvidenceSettings
from radard.judge.classifier import Answer, Probabilities
from radard.judge.decision import Verdict, judge
from radard.judge.evidence import Evidence
from x2train.nets.bundle_answers import Answers
from x2train.nets.calibration import first_windows
from x2train.sets.window_set import Columns, check_made_for, load_windows

Array = NDArray[np.float64]
MAX_RISE = 0.0015  # of the guard's people: 0.2 points are wanted, and others pay more
_MIN_WINDOWS = 500  # with fewer windows of people one more is over 0.2 points
Misses = Mapping[str, tuple[int, int]]
"""People who raise no alarm, and all: in passages; in windows that the rule alone keeps quiet; in
windows at which the temporal head's answer does (`fused`; 0 without one)."""


def allows(before: Misses, after: Misses) -> bool:
    """Return whether another bundle's misses on the same people are within the bound."""
    return all(after[of][0] - was <= MAX_RISE * n for of, (was, n) in before.items())


@dataclass(frozen=True, slots=True, eq=False)
class Guard:
    """Windows of simulated passages, as the network takes them."""

    columns: Columns  # as `x2train.sets.window_set.load_windows` gives them
    abouts: tuple[Mapping[str, Any], ...]  # what the sets were made from

    @property
    def label(self) -> NDArray[np.int64]:
        """Class of every window, by `radard.judge.bundle.CLASSES`."""
        return np.asarray(self.columns["label"], np.int64)

    def of_people(self) -> "Guard":
        """Return the passages in which somebody is."""
        number = self._numbers()
        rows = (np.bincount(number, self.label == CLASSES.index("human")) > 0)[number]
        return Guard({key: values[rows] for key, values in self.columns.items()}, self.abouts)

    @property
    def is_first(self) -> NDArray[np.bool_]:
        """Return where the gate has opened."""
        return first_windows(self.columns)

    def misses(self, bundle: Bundle, answers: Answers) -> Misses:
        """Return how many people are missed by answers to all windows."""
        t_s = np.asarray(self.columns["t_s"], np.float64)
        is_human = self.label == CLASSES.index("human")
        fused_log_p = answers.fused_log_p()

        def missed(p_human: Array) -> int:
            return int((is_human & (1 - p_human > bundle.pet_limit)).sum())

        alarms = np.array(list(alarms_of(bundle, answers, self.is_first, t_s)), bool)
        number = self._numbers()
        has_human = np.bincount(number, is_human) > 0
        # What comes after the person was seen counts too: the alarm may wait for evidence.
        was_seen = np.maximum.accumulate(np.where(is_human, number, -1)) == number
        counts = np.bincount(number, alarms & was_seen) > 0
        n = int(is_human.sum())
        return {
            "passages": (int((has_human & ~counts).sum()), int(has_human.sum())),
            "windows": (missed(answers.p(bundle.temperature)[:, 0]), n),
            "fused": (0 if fused_log_p is None else missed(np.exp(fused_log_p[:, 0])), n),
        }

    def _numbers(self) -> NDArray[np.int64]:
        """Return the number of every window's passage, from 0, over all sets."""
        begins = np.diff(np.asarray(self.columns["passage"]), prepend=-1) != 0
        begins[1:] |= np.diff(np.asarray(self.columns["t_s"])) <= 0
        return np.cumsum(begins) - 1


def load_guard(folders: list[Path], bundle: Bundle, *, least: int = _MIN_WINDOWS) -> Guard:
    """Return the guard of some window sets; UsageError if they do not fit, or hold too few."""
    columns, abouts = load_windows(*folders)
    check_made_for(bundle, columns, abouts[0], folders[0])
    guard = Guard(columns, tuple(abouts))
    n_people = int((guard.label == CLASSES.index("human")).sum())
    if n_people < least:
        raise UsageError(
            f"{folders[0]}: {n_people} windows of people; at least {least} are needed to tell "
            "a rise of 0.2 points: make it with more --passages"
        )
    return guard


def alarms_of(
    bundle: Bundle, answers: Answers, is_first: NDArray[np.bool_], t_s: Array
) -> Iterator[bool]:
    """Yield whether each window is an alarm by the bundle's policy."""
    settings = EvidenceSettings.from_mapping(bundle.evidence)
    evidence = Evidence(settings)
    verdict = Verdict(bundle.pet_limit, settings, DecisionSection().decide_within_s)
    made: list[bool] = []
    p, fused_log_p = answers.p(bundle.temperature).tolist(), answers.fused_log_p()
    for k, (is_new, at_s) in enumerate(zip(is_first, t_s.tolist(), strict=True)):
        window = Probabilities(*p[k])
        if bundle.policy == "window":
            made.append(judge(window, bundle.pet_limit)[1])
            continue
        if is_new:
            # What was before has left.
            if made and verdict.leave():
                made[-1] = True
            evidence.reset()
            verdict.reset()
        answer = Answer(window, None if fused_log_p is None else fused_log_p[k])
        made.append(verdict.judge(evidence.fuse(answer), at_s)[1])
    if made and verdict.leave():
        made[-1] = True
    yield from made
