"""What finetuning leaves behind: a bundle with its provenance, figures before and after."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from radard.judge.bundle import Bundle
from x2train.bundle.metrics import gate_of
from x2train.bundle.writing import write_bundle
from x2train.finetune.finetune import Tuned, quiet_shares
from x2train.finetune.guard import MAX_RISE, Guard
from x2train.finetune.windows import OwnWindows
from x2train.judge.estimates import share

_RECIPE = (
    "Made of the bundle `{base}` for one household: its network, retrained lightly on {n} own "
    "clips with simulated windows mixed in."
)


def write_finetuned(
    folder: Path,
    name: str,
    base: Bundle,
    tuned: Tuned,
    *,
    own: Sequence[OwnWindows],
    guard: Guard,
    command: str,
    seed: int,
) -> Mapping[str, float]:
    """Write the bundle made from `base`; return its metrics.

    The card names the files of own clips and their hashes, never folders.
    """
    metrics = _metrics(tuned, guard)
    training: dict[str, Any] = {
        "recipe": _RECIPE.format(base=base.name, n=len(own)),
        "command": command,
        "seed": seed,
        "finetuned": {
            "way": "full",
            "detail": _detail(tuned),
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
            "guard_sha256": _digest(guard.abouts),
            "most_rise": MAX_RISE,
        },
    }
    write_bundle(
        folder,
        replace(tuned.bundle, name=name),
        training=training,
        metrics=metrics,
        gate=gate_of(guard.abouts),
        notes=_notes(tuned),
    )
    return metrics


def rows_of(tuned: Tuned) -> list[tuple[str, str, str]]:
    """Return what was measured, before and after, for people."""
    before, after = tuned.before, tuned.after
    rows = [
        (
            "simulated people missed, passages",
            _share(before.passages, before.n_passages),
            _share(after.passages, after.n_passages),
        ),
        (
            "simulated people missed, windows",
            _share(before.windows, before.n_windows),
            _share(after.windows, after.n_windows),
        ),
    ]
    if tuned.bundle.n_hidden:
        old_fused, new_fused = (_share(x.fused, x.n_windows) for x in (before, after))
        rows.append(("simulated people missed, windows with those before", old_fused, new_fused))
    for is_human, title in ((False, "own clips of pets with an alarm"), (True, "of people")):
        old, new, n = tuned.count(is_human=is_human)
        if n:
            rows.append((title, _share(old, n), _share(new, n)))
    return rows


def _metrics(tuned: Tuned, guard: Guard) -> Mapping[str, float]:
    before, after = tuned.before, tuned.after
    old, new, _ = tuned.count(is_human=False)
    found = {
        "people missed, passages, before": before.passages / before.n_passages,
        "people missed, passages, after": after.passages / after.n_passages,
        "people missed, windows, before": before.windows / before.n_windows,
        "people missed, windows, after": after.windows / after.n_windows,
        "people missed, fused, before": before.fused / before.n_windows,
        "people missed, fused, after": after.fused / after.n_windows,
        "own clips of pets with an alarm, before": float(old),
        "own clips of pets with an alarm, after": float(new),
        **{
            f"share without alarm, {who}": share
            for who, share in quiet_shares(tuned.bundle, guard).items()
        },
    }
    return {key: round(value, 4) for key, value in found.items()}


def _notes(tuned: Tuned) -> str:
    rows = "\n".join(f"| {name} | {old} | {new} |" for name, old, new in rows_of(tuned))
    return f"""Chosen so that on these simulated people misses rise by no more than
{100 * MAX_RISE:g} points ({_detail(tuned)}), which flatters the figures
a little; brackets hold 95 %. Own clips were learned from, so theirs flatter more. People
were simulated: nothing here was measured on a real one.

| | before | after |
|---|---|---|
{rows}"""


def _detail(tuned: Tuned) -> str:
    return f"{tuned.share:.1f} of the way from the old weights to the trained ones"


def _share(count: int, total: int) -> str:
    found = share(count, total)
    ends = f"{100 * found.low:.1f} to {100 * found.high:.1f}"
    return f"{count} of {total}, {100 * found.value:.2f} % ({ends})"


def _digest(abouts: Sequence[Mapping[str, Any]]) -> str:
    text = json.dumps(list(abouts), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
