"""Light retraining: a bundle's network on own windows, held to what it said of simulated ones.

Its old answers to simulated windows are the aim (learning without forgetting, Li and Hoiem 2016,
recalled). On the line from old to new weights the farthest point is taken at which the guard holds
(weight-space ensembles, Wortsman et al. 2022, recalled).
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from radard.errors import RadardError, UsageError
from radard.judge.bundle import Bundle
from x2train.finetune.guard import MAX_RISE, Guard, Misses, alarms_of
from x2train.finetune.own_clips import OwnWindows
from x2train.nets.bundle_answers import Answers, outputs_of
from x2train.nets.calibration import Epoch
from x2train.nets.graph_net import GraphNet
from x2train.sets.window_set import inputs_of

_BATCH, _OWN_BATCH = 96, 32  # windows a step: own ones are seen often, never alone
_FASTEST = 2e-3  # greatest learning rate of the one cycle
_KEPT, _PEOPLE, _TAUGHT = 2.0, 10.0, 0.3
"""Weights of the old answers, of those to people beside others', and of own windows: settled on
visits of the dog of docs/training.md that its table does not count."""
_PARITY = 1e-3  # of torch from onnxruntime on the old network, logits over temperature
_STEPS = tuple(k / 10 for k in range(10, 0, -1))  # tried in turn, the farthest first


def retrain(
    bundle: Bundle, own: Sequence[OwnWindows], mix: Guard, *, epochs: int, seed: int
) -> Iterator[Epoch | GraphNet]:
    """Train on own clips and `mix`; yield every epoch, and at last the end of the line."""
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
    _check(net, maps, old, temperatures)
    given = {name: np.concatenate([c.inputs[name] for c in own]) for name in inputs}
    # A temporal head is shown what it was given then; the guard lets it run on.
    is_first = np.concatenate([clip.is_first for clip in own])
    mine = [torch.from_numpy(given[name]) for name in inputs] + _hidden(
        outputs_of(bundle.onnx, given, is_first=is_first)
    )
    human = torch.cat([torch.full((len(c.t_s),), float(c.clip.is_human)) for c in own])
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
    yield net


def guarded_line(
    bundle: Bundle, net: GraphNet, guard: Guard, own: Sequence[OwnWindows]
) -> tuple[bytes, float, Misses, Misses]:
    """Return the network that the guard allows, its share of the way, and who is missed."""
    given = inputs_of(bundle, guard.columns)
    is_first = guard.is_first
    before = guard.misses(bundle, outputs_of(bundle.onnx, given, is_first=is_first))
    people = [c for c in own if c.clip.is_human and _has_alarm(bundle, bundle.onnx, c)]
    first = {name: value.clone() for name, value in GraphNet(bundle.onnx).state_dict().items()}
    last = {name: value.clone() for name, value in net.state_dict().items()}
    for share in _STEPS:
        net.load_state_dict({k: first[k] + share * (last[k] - first[k]) for k in first})
        made = net.to_onnx()
        after = guard.misses(bundle, outputs_of(made, given, is_first=is_first))
        if before.allows(after) and all(_has_alarm(bundle, made, clip) for clip in people):
            return made, share, before, after
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


def _check(
    net: GraphNet,
    maps: Sequence[torch.Tensor],
    old: Sequence[torch.Tensor],
    temperatures: tuple[float, float],
) -> None:
    with torch.no_grad():
        ours = net(*(_float(m[:64]) for m in maps))
    rows = zip(ours, old, temperatures, strict=False)
    off = max(float((a / t - b[:64]).abs().max()) for a, b, t in rows)
    if not off <= _PARITY:
        raise RadardError(f"torch and onnxruntime differ by {off:.2g} on this bundle's graph")
