"""A bundle's files: network, sidecar and card, and what an evaluation enters into the two."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radard.errors import UsageError
from radard.judge.bundle import SCHEMA, Bundle, load_bundle, sidecar_path
from x2radar.atomic import write_whole
from x2radar.command import installed_version
from x2train.bundle.recipes import recipe_of
from x2train.judge.estimates import Estimate, share
from x2train.judge.figures import figures
from x2train.judge.report import rounded
from x2train.judge.table import PassageTable
from x2train.judge.verdicts import Outcome, intrusions, levels, outcome
from x2train.sets.windows import GATE

_NOTES = """Measured on windows that training never saw, drawn from the same simulated bodies. They
say nothing about real people and pets."""
_OF_BUNDLE = ("inputs", "features", "stream", "classes", "temperature", "pet_limit", "policy")
_HEAD = "## As an alarm"


def write_bundle(
    folder: Path,
    bundle: Bundle,
    *,
    training: Mapping[str, Any],
    metrics: Mapping[str, Any],
    gate: Mapping[str, float],
    notes: str = _NOTES,
) -> None:
    """Write NAME.onnx, NAME.json and NAME.md, each at once or not at all.

    `training` is recipe, command, seed and whatever else it was made from; `metrics` were measured
    on data that training never saw; `gate` are the settings of the gate that chose the windows to
    train on, empty where there was none; `notes` say on the card what the figures mean, and what
    not.
    """
    training, values = _clips_once(training), asdict(bundle)
    versions = {name: version(name) for name in ("torch", "onnx", "numpy")}
    sidecar = {
        "schema": SCHEMA,
        "name": bundle.name,
        "onnx_sha256": bundle.sha256,
        **{key: values[key] for key in _OF_BUNDLE},
        **({"evidence": dict(bundle.evidence)} if bundle.evidence else {}),
        **({"hidden": bundle.n_hidden} if bundle.n_hidden else {}),
        **({"gate": dict(gate)} if gate else {}),
        "training": {**training, "versions": versions | {"x2radar": installed_version()}},
        "metrics": dict(metrics),
    }
    name, card = bundle.name, _card(sidecar, len(bundle.onnx), notes)
    write_whole(folder / f"{name}.onnx", bundle.onnx)
    write_whole(folder / f"{name}.json", (json.dumps(sidecar, indent=2) + "\n").encode())
    write_whole(folder / f"{name}.md", card.encode())


def _card(sidecar: dict[str, Any], n_bytes: int, notes: str) -> str:
    rows = "\n".join(f"| {key} | {value} |" for key, value in sidecar["metrics"].items())
    stream = "\n".join(f"| {k} | {lo:g} to {hi:g} |" for k, (lo, hi) in sidecar["stream"].items())
    training = sidecar["training"]
    inputs = ", ".join(f"`{i['feature']}`" for i in sidecar["inputs"])
    recipe, clips = recipe_of(training["command"]), training.get("clips", {})
    repeats = "same seed, same file on one machine"
    if training.get("device", "cpu") != "cpu":
        repeats = "on a GPU, which adds in an order of its own: another run differs a little"
    gate = ", ".join(f"{key} {value:g}" for key, value in sidecar.get("gate", {}).items())
    told = f"{recipe} --motion DIR" if clips else recipe
    whole = f"\n\nand with its sets by\n\n    train-export make {told}" if recipe else ""
    return f"""# Model `{sidecar["name"]}`

{training["recipe"]}
{_learned_from(clips)}
Made by one command ({repeats}):

    {training["command"]}{whole}

{notes}

| measure | value |
|---|---|
{rows}

For streams of

| | |
|---|---|
{stream}

Classes: {", ".join(sidecar["classes"])}. No alarm above {sidecar["pet_limit"]:g} pet. Policy
`{sidecar["policy"]}`. Inputs {inputs}, {n_bytes} bytes of weights.{gate and f" Gate: {gate}."}
"""


def _clips_once(training: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return it with the clips of all its sets in one place, by name; sets say how many."""
    clips: dict[str, Any] = dict(training.get("clips", {}))

    def told(value: Any) -> Any:
        if isinstance(value, list):
            return [told(each) for each in value]
        if not isinstance(value, Mapping):
            return value
        made = {key: told(each) for key, each in value.items()}
        if isinstance(value.get("clips"), list):
            for c in value["clips"]:
                clips[c["clip"]] = {k: c[k] for k in ("source", "licence", "sha256")}
            made["clips"] = len(value["clips"])
        return made

    made = told({key: each for key, each in training.items() if key != "clips"})
    return {**made, "clips": dict(sorted(clips.items()))} if clips else made


def _learned_from(clips: Mapping[str, Mapping[str, str]]) -> str:
    """Return a card's paragraph on recorded motion: how many clips under which licence."""
    if not clips:
        return ""
    counts = Counter(clip["licence"] for clip in clips.values())
    rows = "\n".join(f"| {n} | {licence} |" for licence, n in sorted(counts.items()))
    return f"""
It has learned from {len(clips)} clips of recorded and animated motion, which are no part of it;
the sidecar names each with its source and SHA-256. docs/training.md credits their makers.

| clips | licence |
|---|---|
{rows}
"""


def evaluation_of(table: PassageTable, bundle: Bundle, command: str) -> dict[str, Any]:
    """Return a sidecar's ``evaluation``; UsageError without people, or without pets."""
    rng, pets = np.random.default_rng(0), table.label == "pet"
    everything = np.ones(len(table), np.bool_)
    if not intrusions(table).any() or not pets.any():
        raise UsageError("the card needs passages of people and of pets; take more --passages")
    return {
        "policy": bundle.policy,
        "command": command,
        "gate": GATE.model_dump(),
        "passages": len(table),
        "is_matched": figures(table).content["is_matched"],
        "sensitivities": {
            name: _plain(outcome(table, found, everything, rng), found.false_alarms[pets] > 0)
            for name, found in levels(table, bundle)
        },
    }


def write_card(model: str, evaluation: Mapping[str, Any]) -> Path:
    """Replace the evaluation in a bundle's sidecar and card; return the sidecar."""
    load_bundle(model)
    path = sidecar_path(model)
    raw = json.loads(path.read_text(encoding="utf-8"))
    raw["evaluation"] = dict(evaluation)
    write_whole(path, (json.dumps(raw, indent=2) + "\n").encode())
    card = path.with_suffix(".md")
    text = card.read_text(encoding="utf-8") if card.exists() else f"# Model `{raw['name']}`\n"
    text = text.partition(f"\n{_HEAD}")[0].rstrip() + f"\n\n{_section(evaluation)}"
    write_whole(card, text.encode())
    return path


def _plain(found: Outcome, had_alarm: NDArray[np.bool_]) -> dict[str, Any]:
    """Return a sensitivity's rates; `had_alarm` is of every visit of a pet."""
    return {
        "intrusions": found.n_intrusions,
        "missed": _three(found.miss_rate),
        "half_alarmed_after_s": _three(found.median_s),
        "nine_in_ten_alarmed_after_s": _three(found.p90_s),
        "pet_visits": len(had_alarm),
        "visits_with_alarm": _three(share(int(had_alarm.sum()), len(had_alarm))),
        "pet_hours": rounded(found.pet_hours),
        "alarms_per_pet_hour": _three(found.false_alarms_per_hour),
    }


def _three(estimate: Estimate) -> list[float | None]:
    return [rounded(v) if np.isfinite(v) else None for v in estimate]


def _section(evaluation: Mapping[str, Any]) -> str:
    rows = []
    for name, level in evaluation["sensitivities"].items():
        after = " / ".join(
            "never" if v is None else f"{v:.1f} s"
            for v in (level["half_alarmed_after_s"][0], level["nine_in_ten_alarmed_after_s"][0])
        )
        missed, visits = (_percent(level[key]) for key in ("missed", "visits_with_alarm"))
        per_hour = "{:.3g} ({:.3g} to {:.3g})".format(*level["alarms_per_pet_hour"])
        rows.append(f"| {name} | {missed} | {after} | {visits} | {per_hour} |")
    first = next(iter(evaluation["sensitivities"].values()))
    visit_s = 3600 * first["pet_hours"] / first["pet_visits"]
    all_rows = "\n".join(rows)
    return f"""{_HEAD}

Policy `{evaluation["policy"]}` on {evaluation["passages"]} simulated passages that training \
never saw: {first["intrusions"]} people who come in, {first["pet_visits"]} visits of pets of \
{visit_s:.0f} s ({first["pet_hours"]:.4g} hours). In brackets 95 % intervals.

    {evaluation["command"]}

| sensitivity | intrusions missed | alarm after (half / 90 %) | pets' visits with an alarm | \
alarms per pet-hour |
|---|---|---|---|---|
{all_rows}
"""


def _percent(three: list[float]) -> str:
    return "{:.3g} % ({:.3g} to {:.3g})".format(*(100 * v for v in three))
