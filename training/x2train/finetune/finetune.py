"""Finetuning: from own clips and a guard to a bundle that knows one's own pet.

Its network is retrained lightly on own windows and held to what it said of simulated ones
(learning without forgetting, Li and Hoiem 2016, recalled). On the line from old to new weights the
farthest point is taken at which the guard holds (weight-space ensembles, Wortsman et al. 2022,
recalled); what the guard does not allow is not written. The guard is simulated people whom no
finetuning may hide, missed in windows, taken alone, which the rule would keep quiet, and in
passages without any alarm by the bundle's own policy: both rises must stay within the bound.
What is written carries its provenance, and figures from before and after.
"""

import hashlib
import json
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from radard.config.sections import DecisionSection
from radard.errors import UsageError
from radard.judge.bundle import CLASSES, Bundle, EvidenceSettings
from radard.judge.classifier import Answer, Probabilities
from radard.judge.decision import Verdict, judge
from radard.judge.evidence import Evidence
from x2train.bundle.metrics import gate_of, rounded, shares_without_alarm
from x2train.bundle.writing import write_bundle
from x2train.finetune.own_clips import OwnWindows, own_windows
from x2train.judge.estimates import share
from x2train.nets.bundle_answers import Answers, outputs_of
from x2train.nets.calibration import Epoch, first_windows
from x2train.nets.graph_net import GraphNet
from x2train.sets.window_set import Columns, check_made_for, inputs_of, load_windows

_RECIPE = (
    "Made of the bundle `{base}` for one household: its network, retrained lightly on {n} own "
    "clips with simulated windows mixed in."
)
_BATCH, _OWN_BATCH = 96, 32  # windows a step: own ones are seen often, never alone
_FASTEST = 2e-3  # greatest learning rate of the one cycle
_KEPT, _PEOPLE, _TAUGHT = 2.0, 10.0, 0.3
"""Weights of the old answers, of those to people beside others', and of own windows: settled on
visits of the dog of docs/training.md that its table does not count."""
_STEPS = tuple(k / 10 for k in range(10, 0, -1))  # tried in turn, the farthest first
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

        def missed(p_human: NDArray[np.float64]) -> int:
            return int((is_human & (1 - p_human > bundle.pet_limit)).sum())

        alarms = np.array(alarms_of(bundle, answers, self.is_first, t_s), bool)
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
    bundle: Bundle, answers: Answers, is_first: NDArray[np.bool_], t_s: NDArray[np.float64]
) -> list[bool]:
    """Return whether each window is an alarm by the bundle's policy."""
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
    return made


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
    net = yield from _retrained(bundle, own, mix, epochs=epochs, seed=seed)
    onnx, way, before, after = _guarded(bundle, net, guard.of_people(), own)
    better = replace(bundle, onnx=onnx)
    rows = tuple((c.clip.label, c.has_alarm, own_windows(c.clip, better).has_alarm) for c in own)
    tuned = Tuned(better, way, before, after, rows)
    old, new, _ = tuned.count(is_human=False)
    if new >= old:
        raise UsageError(
            f"of {old} own clips of pets with an alarm {new} still have one: nothing was "
            "written; give clips of more visits, or more --epochs"
        )
    yield tuned


def _retrained(
    bundle: Bundle, own: Sequence[OwnWindows], mix: Guard, *, epochs: int, seed: int
) -> Generator[Epoch, None, GraphNet]:
    """Train on own clips and `mix`, yielding every epoch; return the end of the line."""
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    rng = torch.Generator().manual_seed(seed)
    net = GraphNet(bundle.onnx)
    inputs = inputs_of(bundle, mix.columns)
    answers = outputs_of(bundle.onnx, inputs, is_first=mix.is_first)
    n = len(mix.label)
    # The head's answers are calibrated as they are.
    said = (answers.logits / bundle.temperature, answers.fused)
    old = [torch.from_numpy(each.astype(np.float32)) for each in said if each is not None]
    temperatures = (bundle.temperature, 1.0)
    maps = [torch.from_numpy(values) for values in inputs.values()] + _hidden(answers)
    at = bundle.classes.index("human")
    weight = torch.from_numpy(np.where(mix.label == at, _PEOPLE, 1.0).astype(np.float32))
    given = {name: np.concatenate([c.inputs[name] for c in own]) for name in inputs}
    # A temporal head is shown what it was given then; the guard lets it run on.
    is_first = np.concatenate([clip.is_first for clip in own])
    mine = [torch.from_numpy(given[name]) for name in inputs] + _hidden(
        outputs_of(bundle.onnx, given, is_first=is_first)
    )
    human = torch.cat([torch.full((len(c.t_s),), float(c.clip.label == "human")) for c in own])
    optimiser = torch.optim.AdamW(net.parameters(), weight_decay=0.0)
    cycle = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, _FASTEST, total_steps=1 + epochs * -(-n // _BATCH)
    )
    for number in range(1, epochs + 1):
        total = 0.0
        for part in torch.split(torch.randperm(n, generator=rng), _BATCH):
            drawn = torch.randint(len(human), (_OWN_BATCH,), generator=rng)
            batch = [
                torch.cat([_float(m[part]), own_map[drawn]])
                for m, own_map in zip(maps, mine, strict=True)
            ]
            loss: Any = 0.0
            for made, before, temperature in zip(net(*batch), old, temperatures, strict=False):
                log_p = functional.log_softmax(made / temperature, dim=1)
                aim = functional.softmax(before[part], dim=1)
                apart = functional.kl_div(log_p[: len(part)], aim, reduction="none").sum(dim=1)
                kept = (weight[part] * apart).mean()
                p_human = log_p[len(part) :, at].exp().clamp(1e-6, 1 - 1e-6)
                taught = functional.binary_cross_entropy(p_human, human[drawn])
                loss = loss + _KEPT * kept + _TAUGHT * taught
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            cycle.step()
            total += loss.item() * len(part)
        yield Epoch(number, total / n)
    return net


def _guarded(
    bundle: Bundle, net: GraphNet, guard: Guard, own: Sequence[OwnWindows]
) -> tuple[bytes, float, Misses, Misses]:
    """Return the network that the guard allows, its share of the way, and who is missed."""
    given = inputs_of(bundle, guard.columns)
    is_first = guard.is_first
    before = guard.misses(bundle, outputs_of(bundle.onnx, given, is_first=is_first))
    people = [c for c in own if c.clip.label == "human" and _has_alarm(bundle, bundle.onnx, c)]
    first = {name: value.clone() for name, value in GraphNet(bundle.onnx).state_dict().items()}
    last = {name: value.clone() for name, value in net.state_dict().items()}
    for part in _STEPS:
        net.load_state_dict({k: first[k] + part * (last[k] - first[k]) for k in first})
        made = net.to_onnx()
        after = guard.misses(bundle, outputs_of(made, given, is_first=is_first))
        if allows(before, after) and all(_has_alarm(bundle, made, clip) for clip in people):
            return made, part, before, after
    raise UsageError(
        f"every retrained network misses over {100 * MAX_RISE:g} points more people of the "
        "guard, or one of the own clips: nothing was written; give a larger --mix"
    )


def _has_alarm(bundle: Bundle, onnx_bytes: bytes, clip: OwnWindows) -> bool:
    """Return whether any window of a clip is an alarm by the bundle's policy."""
    answers = outputs_of(onnx_bytes, clip.inputs, is_first=clip.is_first)
    return any(alarms_of(bundle, answers, clip.is_first, clip.t_s))


def _float(values: torch.Tensor) -> torch.Tensor:
    return values.float() / 255 if values.dtype == torch.uint8 else values


def _hidden(answers: Answers) -> list[torch.Tensor]:
    return [] if answers.hidden is None else [torch.from_numpy(answers.hidden)]


def rows_of(tuned: Tuned) -> list[tuple[str, str, str]]:
    """Return what was measured, before and after, for people: shares with their intervals."""
    before, after = tuned.before, tuned.after
    words = {"passages": "passages", "windows": "windows", "fused": "windows with those before"}
    counts = [
        (f"simulated people missed, {words[of]}", was, *after[of])
        for of, (was, _) in before.items()
        if of != "fused" or tuned.bundle.n_hidden
    ]
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
            {"file": each.clip.path.name, "sha256": each.sha256}
            | {"label": each.clip.label, "windows": len(each.t_s)}
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
    both = {"before": tuned.before, "after": tuned.after}
    found = {
        f"people missed, {of}, {when}": missed / n
        for when, misses in both.items()
        for of, (missed, n) in misses.items()
    }
    for when, count in zip(both, tuned.count(is_human=False), strict=False):
        found[f"own clips of pets with an alarm, {when}"] = float(count)
    bundle = tuned.bundle
    p = outputs_of(bundle.onnx, inputs_of(bundle, guard.columns)).p(bundle.temperature)
    found |= shares_without_alarm(1 - p[:, 0] > bundle.pet_limit, guard.label)
    return rounded(found)
