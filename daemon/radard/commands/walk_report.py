"""A walk before the radar, from its decisions: what was seen, by range.

Nobody says where the walker is while nothing is seen. Between two sightings at most ten
seconds apart they are taken to have walked straight from one to the other; before the first
and after the last, and in longer gaps, nothing is counted.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from radard.judge.decision import Decision

CELL_M = 0.5
LONGEST_GAP_S = 10.0  # longer, nobody knows where the walker was
MIN_SEEN = 0.9  # of a stretch's windows: a tenth of them is the end of a way, where one turns
MIN_HUMAN = 0.5  # taken for a person: then a body that stays for two raises the alarm
MIN_CELLS = 3  # that a walk needs, to speak for more than the place where somebody stood
_SAME_M = 0.5  # a body so near to the strongest echo is its source


@dataclass(frozen=True, slots=True, kw_only=True)
class WalkDecision:
    """What a walk needs of a decision; p(human) is that of the evidence so far."""

    t_s: float
    range_m: float | None  # where something moves; None while the gate is closed or invalid
    over_floor_db: float | None  # over the noise and the room's own motion; None when invalid
    label: str | None
    p_human: float | None
    alarm: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeCell:
    """What became of the walker in one stretch of range, from `near_m` to `far_m`."""

    near_m: float
    far_m: float
    windows: int  # decisions while the walker was there
    seen: int  # those with the gate open
    alarms: int  # those with an alarm
    visits: int  # how often the walker came in
    missed: int  # visits without a sighting
    # From coming in to the first sighting, the longest of all visits; None without a visit whose
    # beginning is known and that was seen.
    first_seen_s: float | None

    @property
    def is_good(self) -> bool:
        """Whether the alarm may rely on this stretch; the dashboard's walk test has this rule."""
        is_seen = self.seen >= MIN_SEEN * self.windows and not self.missed
        return is_seen and self.alarms >= MIN_HUMAN * self.windows


def step_of(decision: Decision) -> WalkDecision:
    """Return what a walk needs of a decision; the range is that of a body, if there is one."""
    reading = decision.reading
    range_m = None
    if reading is not None and decision.gate == "open":
        range_m = reading.range_m
        near = min(
            (track.range_m for track in decision.tracks),
            key=lambda other_m: abs(other_m - reading.range_m),
            default=None,
        )
        if near is not None and abs(near - range_m) <= _SAME_M:
            range_m = near
    return WalkDecision(
        t_s=decision.t_s,
        range_m=range_m,
        over_floor_db=reading.power_db - reading.noise_floor_db if reading else None,
        label=decision.label,
        p_human=decision.fused.human if decision.fused else None,
        alarm=decision.alarm,
    )


def by_range(steps: Sequence[WalkDecision]) -> list[RangeCell]:
    """Return the cells that the walker was in, near to far, from decisions in their order."""
    steps = [step for step in steps if step.over_floor_db is not None]
    times_s = np.array([step.t_s for step in steps])
    where_m = _walk(times_s, steps)
    cells = [None if math.isnan(m) else math.floor(m / CELL_M) for m in where_m]
    visits: dict[int, list[list[int]]] = {}
    for k, cell in enumerate(cells):
        if cell is None:
            continue
        before = cells[k - 1] if k else None
        if before != cell:
            visits.setdefault(cell, []).append([])
        visits[cell][-1].append(k)
        if before is not None and None not in {steps[k - 1].range_m, steps[k].range_m}:
            # A decision is of all the way since the last one: who walks fast leaves nothing out.
            for passed in range(min(before, cell) + 1, max(before, cell)):
                visits.setdefault(passed, []).append([k])
    return [_cell(cell, visits[cell], steps, where_m) for cell in sorted(visits)]


def _walk(times_s: NDArray[np.float64], steps: Sequence[WalkDecision]) -> NDArray[np.float64]:
    """Return where the walker was at every step, NaN where nobody knows."""
    where_m = np.full(len(steps), np.nan)
    seen = [k for k, step in enumerate(steps) if step.range_m is not None]
    where_m[seen] = [step.range_m for step in steps if step.range_m is not None]
    for a, b in pairwise(seen):
        if times_s[b] - times_s[a] <= LONGEST_GAP_S:
            between = np.arange(a + 1, b)
            where_m[between] = np.interp(times_s[between], times_s[[a, b]], where_m[[a, b]])
    return where_m


def _cell(
    cell: int, visits: list[list[int]], steps: Sequence[WalkDecision], where_m: NDArray[np.float64]
) -> RangeCell:
    inside = [steps[k] for visit in visits for k in visit]
    firsts = [_first_seen(cell, visit, steps, where_m) for visit in visits]
    delays = [delay for delay in firsts if delay is not None]
    return RangeCell(
        near_m=cell * CELL_M,
        far_m=(cell + 1) * CELL_M,
        windows=len(inside),
        seen=sum(step.range_m is not None for step in inside),
        alarms=sum(step.alarm for step in inside),
        visits=len(visits),
        missed=sum(all(steps[k].range_m is None for k in visit) for visit in visits),
        first_seen_s=round(max(delays), 2) if delays else None,
    )


def _first_seen(
    cell: int, visit: list[int], steps: Sequence[WalkDecision], where_m: NDArray[np.float64]
) -> float | None:
    """Return the time from the walker's coming in to the first sighting of a visit."""
    seen = next((k for k in visit if steps[k].range_m is not None), None)
    k = visit[0]
    if seen is None or k == 0 or math.isnan(where_m[k - 1]):
        return None
    edge_m = CELL_M * (cell if where_m[k - 1] < where_m[k] else cell + 1)
    share = (edge_m - where_m[k - 1]) / (where_m[k] - where_m[k - 1])
    came_s = steps[k - 1].t_s + float(np.clip(share, 0, 1)) * (steps[k].t_s - steps[k - 1].t_s)
    return steps[seen].t_s - came_s


def report(steps: Sequence[WalkDecision], cells: Sequence[RangeCell]) -> Iterator[str]:
    """Yield the lines for people."""
    seen = [step for step in steps if step.range_m is not None]
    if not seen:
        yield f"nothing was seen in {len(steps)} windows"
        return
    waited_s = seen[0].t_s - steps[0].t_s
    alarm = next((step for step in steps if step.alarm), None)
    yield f"first seen {waited_s:.1f} s after the first window, at {seen[0].range_m:.1f} m"
    if alarm is None:
        yield "no alarm"
    else:
        yield f"first alarm {alarm.t_s - seen[0].t_s:.1f} s after that"
    yield ""
    yield "range           seen      alarms   visits  missed  first seen after"
    for cell in cells:
        after = "-" if cell.first_seen_s is None else f"{cell.first_seen_s:.1f} s"
        share = f"{100 * cell.seen / cell.windows:.0f} %"
        yield (
            f"{cell.near_m:4.1f} to {cell.far_m:4.1f} m {share:>6} of {cell.windows:<3}"
            f"{cell.alarms:>7}{cell.visits:>9}{cell.missed:>8}  {after}"
        )
    yield ""
    yield verdict(cells)


def verdict(cells: Sequence[RangeCell]) -> str:
    """Return whether a walk is good enough, from its nearest to its farthest stretch, and why."""
    if len(cells) < MIN_CELLS:
        return f"not passed: walk at least {MIN_CELLS * CELL_M:g} m of the range"
    walked = {round(cell.near_m / CELL_M): cell for cell in cells}
    left = [k for k in range(min(walked), max(walked)) if k not in walked]
    bad = [k for k, cell in walked.items() if not cell.is_good]
    for what, found in (("nobody walked", left), ("not good enough", bad)):
        if found:
            where = ", ".join(f"{k * CELL_M:g} to {(k + 1) * CELL_M:g} m" for k in sorted(found))
            return f"not passed: {what} at {where}"
    return f"passed: seen and taken for a person from {cells[0].near_m:g} to {cells[-1].far_m:g} m"
