"""How fast echoes and whole training windows are made, against a dense sum in the same run.

The scene of the first part: 400 frames of 768 bins with 20 scatterers that move through the
swath. The dense form is the echo sum written down in NumPy with complex128 arrays, every
bin of every scatterer; `speedup` is its time over that of the tier that `auto` picks at
-60 dB. A leaner dense form, one scatterer at a time in buffers that are used again, is
timed beside it. Second, training windows of 2 s: motion of 20 scatterers, link budget,
echoes on bins of 29 mm, receiver noise, static clutter, micro-Doppler and range-time map.
Rounds are interleaved, and medians of the rounds' ratios printed. One core; run it alone.
"""

import argparse
import json
import math
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # for tests.echo_references

import numpy as np
from numpy.typing import NDArray

from radard.dsp.doppler import micro_doppler
from tests.echo_references import passband
from x2radar.frame import SPEED_OF_LIGHT_MPS, FastTimeAxis
from x2radar.modules.x2 import RadarSettings
from x2radar.sim.echo import TIERS, Task, choose, echo_sigma_m, frames
from x2radar.sim.signal.pulse import LinkBudget, baseband_noise_power, matched_noise

ERROR_DB = -60.0
N_CPI = 28
Array = NDArray[np.float64]


def x2_axis() -> FastTimeAxis:
    """Return the axis of the X2's baseband frames: 768 bins of 3.66 mm."""
    return replace(RadarSettings().axis, kind="baseband")


def decimated(axis: FastTimeAxis) -> FastTimeAxis:
    """Return the axis of every eighth bin."""
    return replace(axis, n_range=-(-axis.n_range // 8), bin_length_m=8 * axis.bin_length_m)


def motion(rng: np.random.Generator, n_slow: int, n_points: int, rate_hz: float) -> Array:
    """Return ranges of points that walk and swing, shape (n_slow, n_points)."""
    t_s = np.arange(n_slow)[:, None] / rate_hz
    speed_mps = rng.uniform(-1.5, 1.5)
    middle_m = 2.0 + rng.uniform(-0.5, 0.5, n_points)
    swing = 2 * np.pi * (rng.uniform(0.5, 2, n_points) * t_s + rng.random(n_points))
    walk_m = speed_mps * (t_s - t_s[-1] / 2)
    return np.asarray(middle_m + walk_m + rng.uniform(0, 0.2, n_points) * np.sin(swing))


def dense(range_m: Array, amplitude: Array, axis: FastTimeAxis) -> NDArray[np.complex128]:
    """Return the echo sum in one expression."""
    sigma_m = echo_sigma_m(axis)
    weight = amplitude * np.exp(-4j * np.pi * axis.carrier_hz / SPEED_OF_LIGHT_MPS * range_m)
    pulses = np.exp(-0.5 * ((axis.range_m - range_m[..., None]) / sigma_m) ** 2)
    total: NDArray[np.complex128] = (weight[..., None] * pulses).sum(axis=1)
    return total


def lean_dense(range_m: Array, amplitude: Array, axis: FastTimeAxis) -> NDArray[np.complex128]:
    """Return the echo sum, scatterer by scatterer, without allocating anything twice."""
    sigma_m = echo_sigma_m(axis)
    weight = amplitude * np.exp(-4j * np.pi * axis.carrier_hz / SPEED_OF_LIGHT_MPS * range_m)
    shape = (len(range_m), axis.n_range)
    total, echo = np.zeros(shape, np.complex128), np.empty(shape, np.complex128)
    pulse = np.empty(shape)
    for k in range(range_m.shape[1]):
        np.subtract(axis.range_m, range_m[:, k, None], out=pulse)
        np.multiply(pulse, pulse, out=pulse)
        np.multiply(pulse, -0.5 / sigma_m**2, out=pulse)
        np.exp(pulse, out=pulse)
        np.multiply(pulse, weight[:, k, None], out=echo)
        total += echo
    return total


def seconds(work: Callable[[], object], repeats: int = 1) -> float:
    """Return the shortest time of some calls."""
    shortest = math.inf
    for _ in range(repeats):
        started_s = time.perf_counter()
        work()
        shortest = min(shortest, time.perf_counter() - started_s)
    return shortest


def error_db(ours: NDArray[np.complex64], wanted: NDArray[np.complexfloating]) -> float:
    """Return the norm of the difference over the norm, in dB."""
    return float(20 * np.log10(np.linalg.norm(ours - wanted) / np.linalg.norm(wanted)))


def compare(axis: FastTimeAxis, rounds: int) -> dict[str, object]:
    """Time the tiers and the dense forms on the scene, and measure their errors."""
    rng = np.random.default_rng(0)
    range_m = motion(rng, 400, 20, 200.0)
    amplitude = rng.uniform(0.1, 1.0, range_m.shape)
    reference = passband(range_m, amplitude, axis)
    cheapest = choose(Task(400, 20, axis, ERROR_DB))

    def way(tier: str) -> Callable[[], NDArray[np.complex64]]:
        return lambda: frames(range_m, amplitude, axis, error_db=ERROR_DB, tier=tier)

    tiers = {name: way(name) for name in TIERS}
    errors = {name: round(error_db(make(), reference), 1) for name, make in tiers.items()}
    peers = {
        "complex128": lambda: dense(range_m, amplitude, axis),
        "lean": lambda: lean_dense(range_m, amplitude, axis),
    }
    assert all(error_db(peer(), reference) < -120 for peer in peers.values())
    rows = [
        {name: seconds(work, 5) for name, work in peers.items()}
        | {name: seconds(work, 5) for name, work in tiers.items()}
        for _ in range(rounds)
    ]
    middle = {name: statistics.median(row[name] for row in rows) for name in rows[0]}
    return {
        "speedup": round(statistics.median(r["complex128"] / r[cheapest] for r in rows), 1),
        "speedup_over_lean_dense": round(
            statistics.median(r["lean"] / r[cheapest] for r in rows), 1
        ),
        "error_db": errors[cheapest],
        "cheapest_tier": cheapest,
        "tier_error_db": errors,
        "ms": {name: round(1e3 * t, 3) for name, t in middle.items()},
    }


def linearity(axis: FastTimeAxis) -> dict[str, object]:
    """Measure how time grows, over eight times as much: slopes, and distance from a line."""
    rng = np.random.default_rng(1)

    def time_of(n_slow: int, n_points: int) -> float:
        range_m = motion(rng, n_slow, n_points, 200.0)
        amplitude = np.ones_like(range_m)
        return seconds(lambda: frames(range_m, amplitude, axis, error_db=ERROR_DB), 25)

    frame_counts, point_counts = (400, 800, 1600, 3200), (20, 40, 80, 160)
    by_frames = [time_of(n, 20) for n in frame_counts]
    by_points = [time_of(400, n) for n in point_counts]
    return {
        "us_per_frame": round(slope_us(frame_counts, by_frames), 3),
        "frames_off_line": round(off_line(frame_counts, by_frames), 3),
        "us_per_scatterer": round(slope_us(point_counts, by_points), 3),
        "scatterers_off_line": round(off_line(point_counts, by_points), 3),
    }


def straight(counts: tuple[int, ...], times: list[float]) -> np.polynomial.Polynomial:
    """Return the line that leaves the least relative error."""
    return np.polynomial.Polynomial.fit(counts, times, 1, w=1 / np.array(times))


def slope_us(counts: tuple[int, ...], times: list[float]) -> float:
    """Return the line's slope, in microseconds."""
    return float(1e6 * straight(counts, times).convert().coef[1])


def off_line(counts: tuple[int, ...], times: list[float]) -> float:
    """Return the largest share by which a time differs from the line."""
    return float(np.abs(straight(counts, times)(np.array(counts)) / times - 1).max())


def regret(axes: list[FastTimeAxis]) -> float:
    """Return the mean of (time of the tier that auto picks) / (time of the fastest)."""
    shapes = ((1, 20), (30, 5), (147, 20), (400, 1), (400, 60))
    return statistics.mean(one_regret(axis, *shape) for axis in axes for shape in shapes)


def one_regret(axis: FastTimeAxis, n_slow: int, n_points: int) -> float:
    """Return that ratio for one task."""
    range_m = motion(np.random.default_rng(2), n_slow, n_points, 200.0)
    amplitude = np.ones_like(range_m)
    task = Task(n_slow, n_points, axis, ERROR_DB)

    def time_of(tier: str) -> float:
        return seconds(lambda: frames(range_m, amplitude, axis, error_db=ERROR_DB, tier=tier), 9)

    times = {
        name: time_of(name) for name, tier in TIERS.items() if math.isfinite(tier.cost_ns(task))
    }
    return times[choose(task)] / min(times.values())


class Windows:
    """Training windows: from random motion to features, all on one core."""

    def __init__(self, axis: FastTimeAxis, rate_hz: float) -> None:
        self._axis = decimated(axis)
        self._rate_hz = rate_hz
        self._n_slow = round(2 * rate_hz) + N_CPI - 1
        self._budget = LinkBudget()
        self._rng = np.random.default_rng(3)
        noise = baseband_noise_power(self._axis, self._budget.noise_sigma)
        self._clutter_level = math.sqrt(10 ** (57 / 10) * noise)

    def one(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return micro-Doppler and range-time map of a new window."""
        rng = self._rng
        range_m = motion(rng, self._n_slow, 20, self._rate_hz)
        rcs_m2 = rng.uniform(100, 2000, 20)
        amplitude = self._budget.amplitude(range_m, rcs_m2, self._axis)
        y = frames(range_m, amplitude, self._axis, error_db=ERROR_DB)
        y += matched_noise(self._n_slow, self._axis, rng, self._budget.noise_sigma)
        clutter = rng.standard_normal((self._axis.n_range, 2)) @ np.array([1.0, 1j])
        y += (self._clutter_level / math.sqrt(2) * clutter).astype(np.complex64)
        moving = y - y.mean(axis=0)
        range_time = moving.real**2
        range_time += moving.imag**2
        return micro_doppler(y, N_CPI), range_time

    def per_s(self, repeats: int) -> float:
        """Return windows a second: the best of some runs of twenty."""
        return 20 / seconds(lambda: [self.one() for _ in range(20)], repeats)


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=9)
    args = parser.parse_args()
    axis = x2_axis()
    result = compare(axis, args.rounds)
    for rate_hz in (60.0, 200.0):
        windows = Windows(axis, rate_hz)
        windows.one()
        result[f"windows_per_s_{rate_hz:.0f}hz"] = round(windows.per_s(args.rounds), 1)
    result |= linearity(axis)
    result["auto_regret"] = round(regret([axis, decimated(axis), replace(axis, kind="rf")]), 3)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
