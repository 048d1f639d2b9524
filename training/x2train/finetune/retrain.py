"""Light retraining: a bundle's network on own windows, held to what it said of simulated ones.

Simulated windows are no new lesson: the network's own old answers to them are the aim, so that
what it knows stays (learning without forgetting, Li and Hoiem 2016, recalled). Own windows are
taught as people or not. Between the old weights and the new ones lies a line, and on it the
point farthest from the old ones is taken at which the guard holds (weight-space ensembles,
Wortsman et al. 2022, recalled).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from radard.classify.bundle import Bundle
from radard.errors import RadardError, UsageError
from x2train.finetune.guard import MOST_RISE, Guard, Misses
from x2train.finetune.verifier import Seen, first_in_clip
from x2train.finetune.windows import OwnWindows, stacked
from x2train.nets.bundle_answers import Answers, outputs_of
from x2train.nets.epoch import Epoch
from x2train.nets.graph_net import GraphNet

Inputs = Mapping[str, NDArray[Any]]
_BATCH, _OWN_BATCH = 96, 32
_FASTEST = 2e-3
"""Greatest learning rate of the one cycle."""
_KEPT, _PEOPLE, _TAUGHT = 2.0, 10.0, 0.3
"""Weights of the old answers, of those to people beside others', and of own windows."""
_PARITY = 1e-3
_STEPS = tuple(k / 10 for k in range(10, 0, -1))


@dataclass(frozen=True, slots=True, eq=False)
class Retrained:
    """What light retraining gave."""

    onnx: bytes
    share: float
    misses: Misses


def retrain(
    bundle: Bundle, own: Sequence[OwnWindows], mix: Guard, *, epochs: int, seed: int
) -> Iterator[Epoch | GraphNet]:
    """Train; yield every epoch, and at last the network at the end of the line.

    Parameters
    ----------
    bundle : Bundle
        Whose network it is.
    own : sequence of OwnWindows
        Own clips.
    mix : Guard
        Simulated windows.
    epochs : int
        Passes over them.
    seed : int
        Of the order.

    Raises
    ------
    RadardError
        If torch does not compute the bundle's graph as onnxruntime does.
    """
    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    rng = torch.Generator().manual_seed(seed)
    net = GraphNet(bundle.onnx)
    names = [each.name for each in bundle.inputs]
    inputs = mix.inputs(bundle)
    answers, _ = outputs_of(bundle.onnx, inputs, is_first=mix.is_first)
    n = len(mix.label)
    # The head's answers are calibrated as they are.
    old = [_tensor(answers.logits / bundle.temperature)]
    old += [] if answers.fused is None else [_tensor(answers.fused)]
    temperatures = (bundle.temperature, 1.0)
    maps = [torch.from_numpy(inputs[name]) for name in names] + _hidden(answers)
    at = bundle.classes.index("human")
    weight = torch.from_numpy(np.where(mix.label == at, _PEOPLE, 1.0).astype(np.float32))
    _check(net, maps, old, temperatures)
    mine = [torch.from_numpy(np.concatenate([c.inputs[name] for c in own])) for name in names]
    # A temporal head is shown what it was given then; the guard lets it run on.
    seen, _ = outputs_of(bundle.onnx, stacked(own), is_first=_first_in(own))
    mine += _hidden(seen)
    human = torch.from_numpy(
        np.concatenate([np.full(len(c.t_s), c.clip.is_human, np.float32) for c in own])
    )
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
        yield Epoch(number, total / n, float("nan"))
    yield net


def guarded_line(
    bundle: Bundle, net: GraphNet, guard: Guard, own: Sequence[Seen], inputs: Sequence[Inputs]
) -> Retrained:
    """Return the network on the line from old to trained weights that the guard allows.

    Parameters
    ----------
    bundle : Bundle
        The old one.
    net : GraphNet
        The trained network; it is left at the point that is returned.
    guard : Guard
        Simulated people.
    own : sequence of Seen
        Own clips, by the old network; those of people must keep their alarms.
    inputs : sequence of mapping
        The same clips' inputs.

    Raises
    ------
    UsageError
        If no point on the line is allowed.
    """
    given = guard.inputs(bundle)
    is_first = guard.is_first
    before = guard.misses(bundle, outputs_of(bundle.onnx, given, is_first=is_first)[0])
    people = [k for k, clip in enumerate(own) if clip.is_human and clip.has_alarm(bundle)]
    first = {name: value.clone() for name, value in GraphNet(bundle.onnx).state_dict().items()}
    last = {name: value.clone() for name, value in net.state_dict().items()}
    for share in _STEPS:
        net.load_state_dict({k: first[k] + share * (last[k] - first[k]) for k in first})
        made = net.to_onnx()
        after = guard.misses(bundle, outputs_of(made, given, is_first=is_first)[0])
        keeps = all(_keeps_alarm(bundle, made, own[k], inputs[k]) for k in people)
        if keeps and before.allows(after):
            return Retrained(made, share, after)
    msg = (
        f"every retrained network misses over {100 * MOST_RISE:g} points more people of the "
        "guard, or one of the own clips: nothing was written"
    )
    raise UsageError(msg)


def _keeps_alarm(bundle: Bundle, onnx_bytes: bytes, clip: Seen, inputs: Inputs) -> bool:
    made, _ = outputs_of(onnx_bytes, inputs, is_first=first_in_clip(clip.t_s))
    return clip.has_alarm(bundle, made)


def _float(values: torch.Tensor) -> torch.Tensor:
    return values.float() / 255 if values.dtype == torch.uint8 else values


def _first_in(own: Sequence[OwnWindows]) -> NDArray[np.bool_]:
    return np.concatenate([first_in_clip(clip.t_s) for clip in own])


def _hidden(answers: Answers) -> list[torch.Tensor]:
    return [] if answers.hidden is None else [torch.from_numpy(answers.hidden)]


def _tensor(values: NDArray[np.float64]) -> torch.Tensor:
    return torch.from_numpy(values.astype(np.float32))


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
        msg = f"torch and onnxruntime differ by {off:.2g} on this bundle's graph"
        raise RadardError(msg)
