"""Finetuning: from own clips and a guard to the network that knows one's own pet.

It ends at the guard: what it does not allow is not written.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from radard.errors import UsageError
from radard.judge.bundle import CLASSES, Bundle
from x2train.finetune.guard import Guard, Misses
from x2train.finetune.retrain import guarded_line, retrain
from x2train.finetune.windows import OwnWindows, decisions_on
from x2train.nets.bundle_answers import outputs_of
from x2train.nets.epoch import Epoch

_HUMAN = CLASSES.index("human")


@dataclass(frozen=True, slots=True, eq=False)
class Tuned:
    """A network that was finetuned, and what that did."""

    bundle: Bundle  # with the new network, else the old one
    # of people of the guard
    before: Misses
    after: Misses
    # of every own clip: label, whether it was an alarm, whether it is one now; by the daemon's
    # own pipeline. Training has seen them.
    own: tuple[tuple[str, bool, bool], ...]
    share: float  # how far from the old weights to the trained ones it went, 0 to 1

    def count(self, *, is_human: bool) -> tuple[int, int, int]:
        """Return own clips of people or of others: with an alarm before, after, and all."""
        rows = [row for row in self.own if (row[0] == "human") == is_human]
        return sum(r[1] for r in rows), sum(r[2] for r in rows), len(rows)


def tune(
    bundle: Bundle,
    own: Sequence[OwnWindows],
    guard: Guard,
    mix: Guard,
    *,
    epochs: int,
    seed: int,
) -> Iterator[Epoch | Tuned]:
    """Retrain lightly; yield every epoch, and at last the bundle.

    `guard` are simulated people to hold it to, `mix` simulated windows to learn from. Raises
    UsageError if the guard allows no such network, or if it calms no own clip.
    """
    for step in retrain(bundle, own, mix, epochs=epochs, seed=seed):
        if isinstance(step, Epoch):
            yield step
            continue
        made = guarded_line(bundle, step, guard.of_people(), own)
        better = replace(bundle, onnx=made.onnx)
        rows = tuple(
            (c.clip.label, c.n_alarms > 0, any(d.alarm for d in decisions_on(c.clip, better)))
            for c in own
        )
        tuned = Tuned(better, made.before, made.after, rows, made.share)
        old, new, _ = tuned.count(is_human=False)
        if new >= old:
            msg = (
                f"of {old} own clips of pets with an alarm {new} still have one: nothing was "
                "written"
            )
            raise UsageError(msg)
        yield tuned


def quiet_shares(bundle: Bundle, guard: Guard) -> dict[str, float]:
    """Return the share of windows that the rule keeps quiet, by who is in them."""
    answers = outputs_of(bundle.onnx, guard.inputs(bundle))
    p_human = answers.p(bundle.temperature)[:, _HUMAN]
    quiet = 1 - p_human > bundle.pet_limit
    return {
        name: float(quiet[guard.label == k].mean())
        for k, name in enumerate(("person", "pet", "thing"))
        if (guard.label == k).any()
    }
