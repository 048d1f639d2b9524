"""Finetuning: from own clips and a guard to a bundle that knows one's own pet.

It ends at the guard: what that does not allow is not written. What is written carries its
provenance, and figures from before and after.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from radard.errors import UsageError
from radard.judge.bundle import Bundle
from x2train.bundle.metrics import gate_of
from x2train.bundle.writing import write_bundle
from x2train.finetune.guard import MAX_RISE, Guard, Misses
from x2train.finetune.own_clips import OwnWindows, decisions_on
from x2train.finetune.retrain import guarded_line, retrain
from x2train.judge.estimates import share
from x2train.nets.bundle_answers import outputs_of
from x2train.nets.calibration import Epoch
from x2train.sets.window_set import inputs_of

_RECIPE = (
    "Made of the bundle `{base}` for one household: its network, retrained lightly on {n} own "
    "clips with simulated windows mixed in."
)


@dataclass(frozen=True, slots=True, eq=False)
class Tuned:
    """A network that was finetuned, and what that did."""

    bundle: Bundle  # with the new network, else the old one
    way: float  # how far from the old weights to the trained ones it went, 0 to 1
    # of people of the guard
    before: Misses
    after: Misses
    # of every own clip: label, whether it was an alarm, whether it is one now; by the daemon's
    # own pipeline. Training has seen them.
    own: tuple[tuple[str, bool, bool], ...]

    def count(self, *, is_human: bool) -> tuple[int, int, int]:
        """Return own clips of people or of others: with an alarm before, after, and all."""
        rows = [row for row in self.own if (row[0] == "human") == is_human]
        return sum(r[1] for r in rows), sum(r[2] for r in rows), len(rows)


def tune(
    bundle: Bundle, own: Sequence[OwnWindows], guard: Guard, mix: Guard, *, epochs: int, seed: int
) -> Iterator[Epoch | Tuned]:
    """Retrain lightly; yield every epoch, and at last the bundle; UsageError if it cannot."""
    for step in retrain(bundle, own, mix, epochs=epochs, seed=seed):
        if isinstance(step, Epoch):
            yield step
            continue
        onnx, way, before, after = guarded_line(bundle, step, guard.of_people(), own)
        better = replace(bundle, onnx=onnx)
        rows = tuple(
            (c.clip.label, c.n_alarms > 0, any(d.alarm for d in decisions_on(c.clip, better)))
            for c in own
        )
        tuned = Tuned(better, way, before, after, rows)
        old, new, _ = tuned.count(is_human=False)
        if new >= old:
            raise UsageError(
                f"of {old} own clips of pets with an alarm {new} still have one: nothing was "
                "written; give clips of more visits, or more --epochs"
            )
        yield tuned


def rows_of(tuned: Tuned) -> list[tuple[str, str, str]]:
    """Return what was measured, before and after, for people: shares with their intervals."""
    before, after = tuned.before, tuned.after
    counts = [
        ("simulated people missed, passages", before.passages, after.passages, before.n_passages),
        ("simulated people missed, windows", before.windows, after.windows, before.n_windows),
    ]
    if tuned.bundle.n_hidden:
        title = "simulated people missed, windows with those before"
        counts.append((title, before.fused, after.fused, before.n_windows))
    for is_human, title in ((False, "own clips of pets with an alarm"), (True, "of people")):
        counts.append((title, *tuned.count(is_human=is_human)))
    return [(title, _share(old, n), _share(new, n)) for title, old, new, n in counts if n]


def _share(count: int, total: int) -> str:
    found = share(count, total)
    ends = f"{100 * found.low:.1f} to {100 * found.high:.1f}"
    return f"{count} of {total}, {100 * found.value:.2f} % ({ends})"


def write_finetuned(
    path: Path,
    base: Bundle,
    tuned: Tuned,
    *,
    own: Sequence[OwnWindows],
    guard: Guard,
    command: str,
    seed: int,
) -> None:
    """Write the bundle made from `base`; the card names clips and hashes, never folders."""
    detail = f"{tuned.way:.1f} of the way from the old weights to the trained ones"
    abouts = json.dumps(list(guard.abouts), sort_keys=True)
    finetuned = {
        "way": "full",
        "detail": detail,
        "base": base.name,
        "base_onnx_sha256": base.sha256,
        "own": [
            {
                "file": each.clip.path.name,
                "sha256": each.sha256,
                "label": each.clip.label,
                "windows": len(each.t_s),
            }
            for each in own
        ],
        "guard": list(guard.abouts),
        "guard_sha256": hashlib.sha256(abouts.encode()).hexdigest(),
        "most_rise": MAX_RISE,
    }
    rows = "\n".join(f"| {name} | {old} | {new} |" for name, old, new in rows_of(tuned))
    notes = f"""Chosen so that on these simulated people misses rise by no more than
{100 * MAX_RISE:g} points ({detail}), which flatters the figures
a little; brackets hold 95 %. Own clips were learned from, so theirs flatter more. People
were simulated: nothing here was measured on a real one.

| | before | after |
|---|---|---|
{rows}"""
    recipe = _RECIPE.format(base=base.name, n=len(own))
    write_bundle(
        path.parent,
        replace(tuned.bundle, name=path.name),
        training={"recipe": recipe, "command": command, "seed": seed, "finetuned": finetuned},
        metrics=_metrics(tuned, guard),
        gate=gate_of(guard.abouts),
        notes=notes,
    )


def _metrics(tuned: Tuned, guard: Guard) -> Mapping[str, float]:
    both = (("before", tuned.before), ("after", tuned.after))
    found: dict[str, float] = {}
    for when, of in both:
        found[f"people missed, passages, {when}"] = of.passages / of.n_passages
        found[f"people missed, windows, {when}"] = of.windows / of.n_windows
        found[f"people missed, fused, {when}"] = of.fused / of.n_windows
    for (when, _), count in zip(both, tuned.count(is_human=False), strict=False):
        found[f"own clips of pets with an alarm, {when}"] = float(count)
    bundle, label = tuned.bundle, guard.label
    p_human = outputs_of(bundle.onnx, inputs_of(bundle, guard.columns)).p(bundle.temperature)[:, 0]
    quiet = 1 - p_human > bundle.pet_limit
    for k, who in enumerate(("person", "pet", "thing")):
        if (label == k).any():
            found[f"share without alarm, {who}"] = float(quiet[label == k].mean())
    return {key: round(value, 4) for key, value in found.items()}
