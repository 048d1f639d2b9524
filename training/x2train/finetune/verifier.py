"""Verifier: a logistic head that knows one's own pet, and the thresholds that keep it harmless.

It sees what the network's layers see, and learns to tell own windows of what is no human
from windows of simulated people (and of one's own, where some were labelled). Its thresholds,
of a window and of the last few, are the lowest at which people of the guard are missed no more
often than the bound allows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from radard.classify.bundle import CLASSES, Bundle
from radard.errors import UsageError
from x2train.finetune.guard import MOST_RISE, Guard, Misses, alarms_of
from x2train.nets.bundle_answers import Answers
from x2train.nets.bundle_graph import Head, recent_scores
from x2train.nets.evidence_fit import first_windows

Array = NDArray[np.float64]
Rows = NDArray[np.float32]
NOTHING = "nothing was written"
_RIDGE = 0.01
_OWN_PEOPLE = 0.25
"""Share of the weight of all people that own ones have, however few they are."""
_MOST_PEOPLE = 6000
"""More windows of people cost memory, 150 kB each of `accurate`, and teach little."""
_LEAST_SPREAD = 0.01
_PET = CLASSES.index("pet")


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What a bundle's network makes of some windows.

    Attributes
    ----------
    answers : Answers
    rows : ndarray, shape (n, n_seen), float32
        What is seen of them, see `x2train.nets.bundle_graph`.
    t_s : ndarray, shape (n,), float64
        Stream time at the end of each, in seconds.
    is_first : ndarray, shape (n,), bool
        Where the gate has opened.
    is_human : bool
        By the label of the clip.
    """

    answers: Answers
    rows: Rows
    t_s: Array
    is_first: NDArray[np.bool_]
    is_human: bool = False

    def has_alarm(self, bundle: Bundle, answers: Answers | None = None) -> bool:
        """Return whether any of a clip's windows is an alarm by the bundle's policy."""
        known = self.answers if answers is None else answers
        return any(alarms_of(bundle, known, self.is_first, self.t_s))

    def scored(self, head: Head) -> "Scored":
        """Return the windows with a head's scores."""
        score = head.score(self.rows)
        return Scored(self, score, recent_scores(score, self.is_first))


@dataclass(frozen=True, slots=True, eq=False)
class Scored:
    """Windows with the scores of a head, which stay as they are while its thresholds move."""

    seen: Seen
    score: Array
    recent: Array

    def excess(self, head: Head) -> tuple[Array, Array]:
        """Return what a head adds for a pet to windows and, of the last few, to what is fused."""
        return head.excess(self.score), head.fused_excess(self.recent)

    def turned(self, bundle: Bundle, head: Head) -> Answers:
        """Return the answers as the verifier leaves them."""
        excess = self.excess(head)
        return self.seen.answers.turned(*excess, pet=_PET, temperature=bundle.temperature)

    def has_alarm(self, bundle: Bundle, head: Head) -> bool:
        """Return whether any of a clip's windows is an alarm with the verifier."""
        return self.seen.has_alarm(bundle, self.turned(bundle, head))


def first_in_clip(t_s: Array) -> NDArray[np.bool_]:
    """Return where the gate has opened in a clip, of windows at these times, in seconds."""
    return first_windows(np.zeros(len(t_s), np.int64), t_s)


def fit_head(own: Rows, people: Rows, own_people: Rows) -> Head:
    """Return the head that tells own windows from people; its threshold is 0.

    Logistic regression, both sides weighing the same, on standardised values with a ridge.

    Parameters
    ----------
    own : ndarray, shape (n, n_seen), float32
        Windows of what shall be kept quiet.
    people : ndarray, shape (n_people, n_seen), float32
        Windows of simulated people.
    own_people : ndarray, shape (n_own_people, n_seen), float32
        Windows of people in own recordings; may be none.
    """
    if len(people) > _MOST_PEOPLE:
        people = people[np.linspace(0, len(people) - 1, _MOST_PEOPLE).astype(int)]
    z = np.concatenate([own, people, own_people]).astype(np.float64)
    mean, spread = z.mean(axis=0), z.std(axis=0)
    # What hardly ever moves must not decide once it does.
    spread = np.maximum(spread, max(_LEAST_SPREAD * float(np.median(spread)), 1e-9))
    z -= mean
    z /= spread
    share = _OWN_PEOPLE if len(own_people) else 0.0
    weights = np.concatenate(
        [
            np.full(len(own), 0.5 / len(own)),
            np.full(len(people), 0.5 * (1 - share) / len(people)),
            np.full(len(own_people), 0.5 * share / max(1, len(own_people))),
        ]
    )
    sign = np.where(np.arange(len(z)) < len(own), 1.0, -1.0)

    def loss(values: Array) -> tuple[float, Array]:
        margin = sign * (z @ values[:-1] + values[-1])
        lost = weights @ np.logaddexp(0.0, -margin) + 0.5 * _RIDGE * values[:-1] @ values[:-1]
        pull = -weights * sign * np.exp(-np.logaddexp(0.0, margin))
        return float(lost), np.append(z.T @ pull + _RIDGE * values[:-1], pull.sum())

    found = minimize(loss, np.zeros(z.shape[1] + 1), jac=True, method="L-BFGS-B")
    weight = found.x[:-1] / spread
    return Head(weight, float(found.x[-1] - weight @ mean), 0.0)


def guarded(
    head: Head, bundle: Bundle, guard: Guard, seen: Seen, own: Sequence[Seen]
) -> tuple[Head, Misses]:
    """Return the head with the lowest thresholds that the guard allows, and its misses.

    Parameters
    ----------
    head : Head
        From `fit_head`.
    bundle : Bundle
        Whose network it looks at.
    guard : Guard
        Simulated people.
    seen : Seen
        What the network makes of the guard's windows.
    own : sequence of Seen
        Own clips; those of people must keep their alarms.
    """
    before = guard.misses(bundle, seen.answers)
    people = [clip.scored(head) for clip in own if clip.is_human and clip.has_alarm(bundle)]
    scored = seen.scored(head)

    def is_allowed(made: Head) -> bool:
        kept = all(clip.has_alarm(bundle, made) for clip in people)
        return kept and before.allows(guard.misses(bundle, scored.turned(bundle, made)))

    is_human = guard.label == CLASSES.index("human")
    known = [scored.score[is_human], *(clip.score for clip in people)]
    alone = replace(
        head, threshold=_lowest(known, lambda x: is_allowed(replace(head, threshold=x)))
    )
    made = alone
    if seen.answers.fused is not None:
        known = [scored.recent[is_human], *(clip.recent for clip in people)]
        found = _lowest(known, lambda x: is_allowed(replace(alone, fused_threshold=x)))
        made = replace(alone, fused_threshold=found)
    return made, guard.misses(bundle, scored.turned(bundle, made))


def _lowest(of_people: Sequence[Array], is_allowed: Callable[[float], bool]) -> float:
    """Return the lowest of people's scores that is allowed, with all that were tried above it.

    At the highest no person is touched at all, so that one always is.
    """
    scores = np.unique(np.concatenate(of_people))
    low, high = -1, len(scores) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if is_allowed(float(scores[middle])):
            high = middle
        else:
            low = middle
    return float(scores[high])


def check_use(own: Sequence[Seen], head: Head) -> None:
    """Raise UsageError if a head quietens no window of own clips within the bound."""
    if not any((x > 0).any() for c in own if not c.is_human for x in c.scored(head).excess(head)):
        msg = (
            f"within {100 * MOST_RISE:g} points of people missed the verifier would quieten no "
            f"window of the own clips: {NOTHING}"
        )
        raise UsageError(msg)
