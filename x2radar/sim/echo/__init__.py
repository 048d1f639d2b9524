"""Echo engines: which tier makes given frames in the least time with the error that is asked for.

| tier | error down to | its cost grows with |
|---|---|---|
| dense | -130 dB | bins x scatterers |
| local | -100 dB | scatterers x the bins that an echo touches |
| gridded | -100 dB | scatterers x 8 to 15 grid points, and bins |

Errors are the largest of any bin over the sum of the amplitudes. The costs are linear models in
nanoseconds, fitted on one core at 1 to 400 frames, 1 to 200 scatterers, six axes; measured times
were 0.7 to 1.8 times the model, and over those tasks the choice took 1.4 % longer than the best
tier of each. `benchmarks/bench_sim.py` measures it again. Dense serves up to five echoes or errors
under -100 dB, gridded the X2's own bins and RF, local decimated bins.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from x2radar.frame import FastTimeAxis, Samples
from x2radar.sim.echo import tiers
from x2radar.sim.echo.tiers import Task, blocks, echo_sigma_m
from x2radar.sim.points import Array

__all__ = ["TIERS", "Task", "choose", "echo_sigma_m", "frames"]


@dataclass(frozen=True, slots=True)
class Tier:
    """A way to make frames of echoes, with its error and its cost."""

    frames: Callable[[Array, Array, Task, float], Samples]
    finest_db: float  # smallest error that it can be asked for
    cost_ns: Callable[[Task], float]  # an estimate; infinite if the tier cannot do it


def _dense_ns(task: Task) -> float:
    return 2.5e4 + task.axis.n_range * task.n_slow * (3.5 * task.n_points + 3.2)


def _local_ns(task: Task) -> float:
    axis = task.axis
    sigma_bins = echo_sigma_m(axis) / axis.bin_length_m
    touched = tiers.n_touched(sigma_bins, task.error_db)
    n_calls = len(blocks(task.n_slow, task.n_points, touched))
    bins_ns = (1.4 if axis.kind == "rf" else 0.4) * axis.n_range
    frame_ns = 2.3 * touched * task.n_points + bins_ns
    return n_calls * (5e4 + 1500.0 * touched) + frame_ns * task.n_slow


def _gridded_ns(task: Task) -> float:
    if not tiers.suits(task.axis):
        return math.inf
    made = tiers.design_for(task.axis, task.error_db)
    frame_ns = tiers.frame_ns(made.n_blocks, made.n_block, made.n_window)
    frame_ns *= 1.2 if task.axis.kind == "rf" else 1.5
    frame_ns += (5 + 1.7 * made.grid.n_touched) * task.n_points
    return len(blocks(task.n_slow, task.n_points)) * 5e4 + frame_ns * task.n_slow


TIERS: Mapping[str, Tier] = {
    "dense": Tier(tiers.dense_frames, tiers.DENSE_FINEST_DB, _dense_ns),
    "local": Tier(tiers.local_frames, tiers.FINEST_DB, _local_ns),
    "gridded": Tier(tiers.gridded_frames, tiers.FINEST_DB, _gridded_ns),
}


def choose(task: Task) -> str:
    """Return the name of the cheapest tier for an error of -130 to -20 dB."""
    able = [name for name, tier in TIERS.items() if tier.finest_db <= task.error_db]
    return min(able, key=lambda name: TIERS[name].cost_ns(task))


def frames(
    range_m: Array,
    amplitude: Array,
    axis: FastTimeAxis,
    *,
    error_db: float = -60.0,
    floor: float = 0.0,
    tier: str | None = None,
) -> Samples:
    """Return noise-free frames of moving points, shape (n_slow, n_range), in the axis' type.

    Distances, constant within a frame (2.16), and signed peak amplitudes, without NaN, are of
    shape (n_slow, n_points). `error_db`, -130 to -20 dB, is the largest error of a bin over
    the sum of the frame's amplitudes; echoes up to `floor` are left out: say a tenth of the noise.
    `tier`, one of `TIERS`, makes them instead of the cheapest.

    The phase is exp(-j 4 pi R / lambda), or its conjugate if the axis' `phase_sign` is +1.
    Baseband is the matched filter's output and RF is what the filter takes: where an echo lies in
    the swath as a whole, down-converting the RF frames gives the baseband frames. Raises
    SceneError if the axis has no bandwidth.
    """
    n_slow, n_points = range_m.shape
    task = Task(n_slow, n_points, axis, error_db)
    return TIERS[tier or choose(task)].frames(range_m, amplitude, task, floor)
