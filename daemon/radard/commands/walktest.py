"""`radard walktest`: walk before the radar and see what it sees, then read the report by range.

Nobody says where the walker is while nothing is seen. Between two sightings at most ten
seconds apart they are taken to have walked straight from one to the other; before the first
and after the last, and in longer gaps, nothing is counted.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from statistics import median

import numpy as np
from numpy.typing import NDArray

from radard.config.directories import calibration_file, for_service, saved_file
from radard.config.options import LISTENING, LONGEST_S, add_options, check_limits, listening_config
from radard.config.saved import change
from radard.errors import RadardError, UsageError
from radard.judge.decision import Decision
from radard.judge.installation import echo_at_1m_db
from radard.run.components import Listening, listen, use_calibration
from radard.stream.ring import Notice
from x2radar.command import Parser, StatusLine, bar, new_parser

_ABOUT = "Log what the radar sees while somebody walks; report it by range at the end."
_EXAMPLES = """\
examples:
  radard walktest --port /dev/ttyACM0          Ctrl-C ends it with the report
  radard walktest --port /dev/ttyACM0 --adult  and keep how strong an adult's echo is
  radard walktest --port sim:human --speed max --duration 60
  radard walktest --port replay:walk.h5 --json > walk.json

Walk slowly from the farthest corner to the radar and back, then along walls.
"""
CELL_M = 0.5
LONGEST_GAP_S = 10.0  # longer, nobody knows where the walker was
MIN_SEEN = 0.9  # of a stretch's windows: a tenth of them is the end of a way, where one turns
MIN_HUMAN = 0.5  # taken for a person: then a body that stays for two raises the alarm
MIN_CELLS = 3  # that a walk needs, to speak for more than the place where somebody stood
_SAME_M = 0.5  # a body so near to the strongest echo is its source
_FULL_DB = 30.0  # over the floor of the room, of a full bar: a walker near the radar
_MIN_ECHOES = 5  # decisions that a level needs: a walk there and back
_LEVEL = (
    "Level: {0:.1f} dB at 1 m. If an adult walked, mount.level_db: {0:.1f} in the configuration "
    "lets the alarm judge sizes; --adult keeps it."
)


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


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    check_limits(args, duration=(1, LONGEST_S))
    config = listening_config(args)
    kept = None
    if args.adult:
        if config.sensor.kind in {"sim", "replay"}:
            raise UsageError("--adult: only a real radar's level is kept as its own")
        # Where the daemon finds it.
        kept = for_service(config, saved_file(config, "settings"))
    with listen(config) as listening:
        # What holds for the daemon holds for the test of it.
        use_calibration(config, listening.pipeline, is_live=listening.source.is_live)
        if config.gate.calibration == "auto" and listening.pipeline.calibration is not None:
            sys.stderr.write(f"calibration: {calibration_file(config)}\n")
        steps, level_db = _walked(listening, args)
    cells = by_range(steps)
    if args.json:
        shown = {"cells": [asdict(c) for c in cells], "log": [asdict(s) for s in steps]}
        print(json.dumps({**shown, "level_db": level_db}))
    else:
        print("", *report(steps, cells), sep="\n")
        if level_db is not None and kept is None:
            print(_LEVEL.format(level_db))
    if kept is None:
        return 0
    if level_db is None:
        raise RadardError(f"--adult: seen in under {_MIN_ECHOES} windows, which tells no level")
    try:
        change(kept, "settings", {"mount": {"level_db": level_db}})
    except ValueError as err:
        raise RadardError(f"--adult: {err}") from err
    sys.stderr.write(f"mount.level_db: {level_db:.1f}, an adult's level, is kept in {kept}\n")
    return 0


def make_parser() -> Parser:
    parser = new_parser("radard walktest", _ABOUT, _EXAMPLES)
    add_options(parser, *LISTENING)
    add = parser.add_argument
    add("--duration", type=float, default=LONGEST_S, metavar="S", help="seconds (till Ctrl-C)")
    add("--adult", action="store_true", help="an adult walks: keep the level, so that size counts")
    add("--json", action="store_true", help="log and report as one JSON object at the end")
    return parser


def line_of(step: WalkDecision) -> str:
    """Return the line of the log for one decision."""
    if step.over_floor_db is None:
        return f"{step.t_s:7.1f} s  window invalid: too many frames missing"
    over_db = step.over_floor_db
    head = f"{step.t_s:7.1f} s  {over_db:+6.1f} dB  {bar(over_db / _FULL_DB, 20)}"
    if step.range_m is None:
        return f"{head}  nothing"
    p_human = "" if step.p_human is None else f" {step.p_human:.2f}"
    alarm = "  ALARM" if step.alarm else ""
    return f"{head}  {step.range_m:4.1f} m  {step.label or 'moves'}{p_human}{alarm}"


def _walked(
    listening: Listening, args: argparse.Namespace
) -> tuple[list[WalkDecision], float | None]:
    """Return the log, and the median strength of what moved at 1 m (`mount.level_db`)."""
    steps: list[WalkDecision] = []
    echoes: list[float] = []
    pipeline, line = listening.pipeline, StatusLine(sys.stderr)
    try:
        for item in listening.dwells(args.duration):
            if isinstance(item, Notice):
                pipeline.restart()
                continue
            step = step_of(pipeline.decide(item))
            steps.append(step)
            gate, range_m = pipeline.gate, item.axis.range_m
            echo_db = echo_at_1m_db(gate.power, gate.noise, range_m)
            if step.range_m is not None and echo_db is not None:
                echoes.append(echo_db)
            line.clear()
            if not args.json:
                print(line_of(step), flush=True)
            seen = "nothing" if step.range_m is None else f"{step.range_m:.1f} m"
            share = (step.over_floor_db or 0.0) / _FULL_DB
            line.show(f"[{bar(share)}] {seen}; Ctrl-C ends the walk")
    except KeyboardInterrupt:
        pass  # the way to end a walk: now comes the report
    finally:
        line.clear()
    return steps, round(median(echoes), 1) if len(echoes) >= _MIN_ECHOES else None


def step_of(decision: Decision) -> WalkDecision:
    """Return what a walk needs of a decision; the range is that of a body, if there is one."""
    reading = decision.reading
    range_m = None
    if reading is not None and decision.gate == "open":
        echo_m = reading.range_m
        near_m = [t.range_m for t in decision.tracks if abs(t.range_m - echo_m) <= _SAME_M]
        range_m = min(near_m, key=lambda m: abs(m - echo_m), default=echo_m)
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
    seen = [(step.t_s, step.range_m) for step in steps if step.range_m is not None]
    if not seen:
        return []
    times_s, (seen_s, seen_m) = np.array([step.t_s for step in steps]), np.array(seen).T
    where_m = np.interp(times_s, seen_s, seen_m, left=np.nan, right=np.nan)
    for a, b in pairwise(seen_s):
        if b - a > LONGEST_GAP_S:
            where_m[(a < times_s) & (times_s < b)] = np.nan
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


def _cell(
    cell: int, visits: list[list[int]], steps: Sequence[WalkDecision], where_m: NDArray[np.float64]
) -> RangeCell:
    inside = [steps[k] for visit in visits for k in visit]
    missed, delays = 0, []
    for visit in visits:
        k, seen = visit[0], [k for k in visit if steps[k].range_m is not None]
        missed += not seen
        if seen and k > 0 and not math.isnan(where_m[k - 1]):
            # The walker came in over an edge, somewhere between two decisions.
            edge_m = CELL_M * (cell if where_m[k - 1] < where_m[k] else cell + 1)
            share = (edge_m - where_m[k - 1]) / (where_m[k] - where_m[k - 1])
            between_s = steps[k].t_s - steps[k - 1].t_s
            came_s = steps[k - 1].t_s + float(np.clip(share, 0, 1)) * between_s
            delays.append(steps[seen[0]].t_s - came_s)
    return RangeCell(
        near_m=cell * CELL_M,
        far_m=(cell + 1) * CELL_M,
        windows=len(inside),
        seen=sum(step.range_m is not None for step in inside),
        alarms=sum(step.alarm for step in inside),
        visits=len(visits),
        missed=missed,
        first_seen_s=round(max(delays), 2) if delays else None,
    )


def report(steps: Sequence[WalkDecision], cells: Sequence[RangeCell]) -> Iterator[str]:
    """Yield the lines for people."""
    seen = [step for step in steps if step.range_m is not None]
    if not seen:
        yield f"nothing was seen in {len(steps)} windows"
        return
    first, alarm_s = seen[0], next((step.t_s for step in steps if step.alarm), None)
    waited_s = first.t_s - steps[0].t_s
    yield f"first seen {waited_s:.1f} s after the first window, at {first.range_m:.1f} m"
    yield "no alarm" if alarm_s is None else f"first alarm {alarm_s - first.t_s:.1f} s after that"
    yield ""
    yield "range           seen      alarms   visits  missed  first seen after"
    for cell in cells:
        after = "-" if cell.first_seen_s is None else f"{cell.first_seen_s:.1f} s"
        share = f"{100 * cell.seen / cell.windows:.0f} %"
        stretch = f"{cell.near_m:4.1f} to {cell.far_m:4.1f} m {share:>6} of {cell.windows:<3}"
        yield f"{stretch}{cell.alarms:>7}{cell.visits:>9}{cell.missed:>8}  {after}"
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
