"""What a window costs in training: as torch runs it, in bfloat16, compiled, in one run.

CPU time, which a busy computer hardly changes: medians of interleaved steps of 128 windows on one
thread, augmentation and optimiser included; windows and GFLOP a second of the plain way beside
those of a matrix product on the same thread.
"""

import argparse
import json
import time
from collections.abc import Callable

import numpy as np
import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from radard.judge.features import feature_shape
from radard.judge.installation import N_INSTALLATION
from x2train.commands.dataset import FEATURES
from x2train.commands.fit import WIDTHS
from x2train.nets.map_fit import MAPS, MuonAdamW, augmented, hidden_more
from x2train.nets.nets import MapFitSettings, MapNet

_WAYS = {
    "plain": (False, False),
    "half": (True, False),
    "compile": (False, True),
    "half_compile": (True, True),
}
_N_FIRST = 3
"""Steps that are not counted: the first one compiles."""


def step_of(size: str, *, is_half: bool, is_compiled: bool) -> Callable[[], None]:
    """Return what takes one step, on maps of noise."""
    settings = MapFitSettings(*WIDTHS[size])
    rng = torch.Generator().manual_seed(0)
    shapes = [feature_shape(name, FEATURES) for name in MAPS]
    maps = [torch.rand(settings.batch, *shape, generator=rng) for shape in shapes]
    known = torch.rand(settings.batch, N_INSTALLATION, generator=rng)
    labels = torch.arange(settings.batch) % 3
    net = MapNet(tuple(shape[0] for shape in shapes), settings)
    optimizer = MuonAdamW(net, 10_000, settings)
    answer = torch.compile(net, dynamic=False) if is_compiled else net
    error = nn.CrossEntropyLoss()

    def step() -> None:
        batch = (*augmented(*maps, rng=rng), hidden_more(known, rng))
        with torch.autocast("cpu", torch.bfloat16, enabled=is_half):
            answers = answer(*batch)
        optimizer.step(error(answers.float(), labels))

    return step


_N_MATRIX = 512


def matrix_product() -> None:
    """Multiply two matrices as large as a cache likes them."""
    a = torch.ones(_N_MATRIX, _N_MATRIX)
    torch.mm(a, a)


def flops_of(step: Callable[[], None]) -> int:
    """Return the floating-point operations of a step's convolutions and products."""
    with FlopCounterMode(display=False) as counter:
        step()
    return int(counter.get_total_flops())


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", choices=sorted(WIDTHS), default="balanced")
    parser.add_argument("--steps", type=int, default=20)
    others = list(_WAYS)[1:]
    parser.add_argument("--ways", nargs="*", default=others, choices=others, help="beside plain")
    args = parser.parse_args()
    torch.set_num_threads(1)
    ways = ["plain", *args.ways]
    steps = {
        name: step_of(args.size, is_half=half, is_compiled=compiled)
        for name, (half, compiled) in _WAYS.items()
        if name in ways
    }
    flops = flops_of(steps["plain"])
    steps["matrix_product"] = matrix_product
    took_s: dict[str, list[float]] = {name: [] for name in steps}
    for number in range(_N_FIRST + args.steps):
        for name, step in steps.items():
            started_s = time.process_time()
            step()
            if number >= _N_FIRST:
                took_s[name].append(time.process_time() - started_s)
    batch = MapFitSettings().batch
    median_s = {name: float(np.median(t)) for name, t in took_s.items()}
    us = {f"us_{name}": 1e6 * median_s[name] / batch for name in ways}
    ratios = {f"speedup_{k}": us["us_plain"] / us[f"us_{k}"] for k in ways[1:]}
    machine = 2e-9 * _N_MATRIX**3 / median_s["matrix_product"]
    network = 1e-9 * flops / median_s["plain"]
    rates = {"windows_per_s": batch / median_s["plain"], "gflops": network}
    rates |= {"gflops_of_matrix_product": machine, "share_of_machine": network / machine}
    print(json.dumps({key: round(value, 3) for key, value in {**us, **ratios, **rates}.items()}))


if __name__ == "__main__":
    main()
