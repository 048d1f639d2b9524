"""Finetuning: from own clips and a guard to the network that knows one's own pet.

Either way ends at the guard: what it does not allow is not written.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from radard.classify.bundle import CLASSES, Bundle
from radard.errors import UsageError
from x2train.finetune.guard import Guard, Misses
from x2train.finetune.retrain import guarded_line, retrain
from x2train.finetune.verifier import NOTHING, Seen, check_use, first_in_clip, fit_head, guarded
from x2train.finetune.windows import OwnWindows, decisions_on, stacked
from x2train.nets.bundle_answers import outputs_of
from x2train.nets.bundle_graph import MEMORY, N_KEPT, Head, with_verifier
from x2train.nets.epoch import Epoch

Tell = Callable[[str], None]
_PET = CLASSES.index("pet")
_HUMAN = CLASSES.index("human")
_LEAST_LEFT = 3
"""Fewer clips of pets cannot spare one."""


@dataclass(frozen=True, slots=True, eq=False)
class Tuned:
    """A network that was finetuned, and what that did.

    Attributes
    ----------
    bundle : Bundle
        With the new network, else the old one.
    before, after : Misses
        Of people of the guard.
    own : tuple of (str, bool, bool)
        Of every own clip: label, whether it was an alarm, whether it is one now; by the
        daemon's own pipeline. Training has seen them.
    left_out : tuple of int or None
        Clips of pets with an alarm that stay quiet by a verifier that has not seen them, and
        all of those clips; None when that was not tried.
    detail : str
        Threshold, or how far from the old weights.
    """

    bundle: Bundle
    before: Misses
    after: Misses
    own: tuple[tuple[str, bool, bool], ...]
    left_out: tuple[int, int] | None
    detail: str

    def count(self, *, is_human: bool) -> tuple[int, int, int]:
        """Return own clips of people or of others: with an alarm before, after, and all."""
        rows = [row for row in self.own if (row[0] == "human") == is_human]
        return sum(r[1] for r in rows), sum(r[2] for r in rows), len(rows)


def tune_verifier(
    bundle: Bundle, own: Sequence[OwnWindows], guard: Guard, mix: Guard | None, tell: Tell
) -> Tuned:
    """Return the bundle with a verifier beside its last layer.

    Parameters
    ----------
    bundle : Bundle
        Without a verifier.
    own : sequence of OwnWindows
        Own clips, some of them of pets.
    guard : Guard
        Simulated people to hold it to.
    mix : Guard or None
        Simulated people to learn from; None takes half of the guard's passages for that,
        which then count no more.
    tell : callable
        Is told of every step.

    Raises
    ------
    UsageError
        If within the guard's bound it would quieten nothing.
    """
    learned, held = guard.halves() if mix is None else (mix, guard)
    tell("what the network sees of simulated people")
    people = see(bundle, learned.part(learned.label == _HUMAN)).rows
    held = held.of_people()
    seen = see(bundle, held)
    clips = [_seen(bundle, each) for each in own]

    def made_of(taught: Sequence[Seen]) -> tuple[Head, Misses]:
        pets = np.concatenate([c.rows for c in taught if not c.is_human])
        none = np.zeros((0, people.shape[1]), np.float32)
        mine = np.concatenate([none, *(c.rows for c in taught if c.is_human)])
        return guarded(fit_head(pets, people, mine), bundle, held, seen, clips)

    tell("a verifier of all own clips")
    head, after = made_of(clips)
    check_use(clips, head)
    made = replace(
        bundle,
        onnx=with_verifier(bundle.onnx, head, pet=_PET, temperature=bundle.temperature),
        n_hidden=bundle.n_hidden + N_KEPT if bundle.n_hidden else 0,
    )
    return _tuned(
        made,
        own,
        held.misses(bundle, seen.answers),
        after,
        left_out=_left_out(bundle, clips, made_of, tell),
        detail=_thresholds(head),
    )


def tune_network(
    bundle: Bundle,
    own: Sequence[OwnWindows],
    guard: Guard,
    mix: Guard,
    *,
    epochs: int,
    seed: int,
) -> Iterator[Epoch | Tuned]:
    """Retrain lightly; yield every epoch, and at last the bundle.

    Parameters
    ----------
    bundle : Bundle
        The old one.
    own : sequence of OwnWindows
        Own clips.
    guard, mix : Guard
        Simulated people to hold it to, and simulated windows mixed in.
    epochs, seed : int
        Passes over the mix, and the order.

    Raises
    ------
    UsageError
        If the guard allows no such network.
    """
    clips = [_seen(bundle, each) for each in own]
    for step in retrain(bundle, own, mix, epochs=epochs, seed=seed):
        if isinstance(step, Epoch):
            yield step
            continue
        held = guard.of_people()
        made = guarded_line(bundle, step, held, clips, [each.inputs for each in own])
        before = held.misses(bundle, see(bundle, held, with_rows=False).answers)
        detail = f"{made.share:.1f} of the way from the old weights to the trained ones"
        tuned = _tuned(
            replace(bundle, onnx=made.onnx), own, before, made.misses, left_out=None, detail=detail
        )
        old, new, _ = tuned.count(is_human=False)
        if new >= old:
            msg = f"of {old} own clips of pets with an alarm {new} still have one: {NOTHING}"
            raise UsageError(msg)
        yield tuned


def see(bundle: Bundle, guard: Guard, *, with_rows: bool = True) -> Seen:
    """Return what a bundle's network makes of simulated windows."""
    made = outputs_of(
        bundle.onnx, guard.inputs(bundle), is_first=guard.is_first, with_what_is_seen=with_rows
    )
    return Seen(*made, np.asarray(guard.columns["t_s"], np.float64), guard.is_first)


def quiet_shares(bundle: Bundle, guard: Guard) -> dict[str, float]:
    """Return the share of windows that the rule keeps quiet, by who is in them."""
    answers, _ = outputs_of(bundle.onnx, guard.inputs(bundle))
    p_human = answers.p(bundle.temperature)[:, _HUMAN]
    quiet = 1 - p_human > bundle.pet_limit
    return {
        name: float(quiet[guard.label == k].mean())
        for k, name in enumerate(("person", "pet", "thing"))
        if (guard.label == k).any()
    }


def _left_out(
    bundle: Bundle,
    clips: Sequence[Seen],
    made_of: Callable[[Sequence[Seen]], tuple[Head, Misses]],
    tell: Tell,
) -> tuple[int, int] | None:
    """Return how many clips stay quiet by verifiers that have not seen them."""
    pets = [clip for clip in clips if not clip.is_human]
    alarms = [clip for clip in pets if clip.has_alarm(bundle)]
    if len(pets) < _LEAST_LEFT or not alarms:
        return None
    n_quiet = 0
    for k, clip in enumerate(alarms, 1):
        tell(f"without own clip {k} of {len(alarms)}")
        head, _ = made_of([other for other in clips if other is not clip])
        n_quiet += not clip.scored(head).has_alarm(bundle, head)
    return n_quiet, len(alarms)


def _seen(bundle: Bundle, own: OwnWindows) -> Seen:
    is_first = first_in_clip(own.t_s)
    made = outputs_of(bundle.onnx, stacked([own]), is_first=is_first, with_what_is_seen=True)
    return Seen(*made, own.t_s, is_first, own.clip.is_human)


def _thresholds(head: Head) -> str:
    text = f"threshold {head.threshold:.2f} nats"
    if np.isfinite(head.fused_threshold):
        text += f", {head.fused_threshold:.2f} over the last {MEMORY} windows"
    return text


def _tuned(
    made: Bundle,
    own: Sequence[OwnWindows],
    before: Misses,
    after: Misses,
    *,
    left_out: tuple[int, int] | None,
    detail: str,
) -> Tuned:
    rows = tuple(
        (c.clip.label, c.n_alarms > 0, any(d.alarm for d in decisions_on(c.clip, made)))
        for c in own
    )
    return Tuned(made, before, after, rows, left_out, detail)
