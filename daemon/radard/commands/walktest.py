"""`radard walktest`: walk before the radar and see what it sees, then read the report."""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import median

from radard.commands.walk_report import WalkDecision, by_range, report, step_of
from radard.config.config import Config
from radard.config.directories import calibration_file, for_service, saved_file
from radard.config.options import (
    LISTENING,
    LONGEST_S,
    add_options,
    check_seconds,
    listening_config,
)
from radard.config.saved import change
from radard.errors import RadardError, UsageError
from radard.judge.installation import echo_at_1m_db
from radard.run.components import Listening, listen, use_calibration
from radard.stream.ring import Notice
from x2radar.command import Parser, StatusLine, bar, new_parser

_EXAMPLES = """\
examples:
  radard walktest --port /dev/ttyACM0          Ctrl-C ends it with the report
  radard walktest --port /dev/ttyACM0 --adult  and keep how strong an adult's echo is
  radard walktest --port sim:human --speed max --duration 60
  radard walktest --port replay:walk.h5 --json > walk.json

Walk slowly from the farthest corner to the radar and back, then along walls.
"""
_FULL_DB = 30.0  # of a full bar: a walker near the radar
_BAR = 20
_MIN_ECHOES = 5  # decisions that a level needs: a walk there and back
_LEVEL = (
    "Level: {0:.1f} dB at 1 m. If an adult walked, mount.level_db: {0:.1f} in the configuration "
    "lets the alarm judge sizes; --adult keeps it."
)


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    check_seconds("--duration", args.duration, 1.0)
    config = listening_config(args)
    kept = _kept_file(config) if args.adult else None
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
    if kept is not None:
        _keep(kept, level_db)
    return 0


def _kept_file(config: Config) -> Path:
    """Return where the daemon finds an adult's level."""
    if config.sensor.kind in {"sim", "replay"}:
        raise UsageError("--adult: only a real radar's level is kept as its own")
    return for_service(config, saved_file(config, "settings"))


def _keep(path: Path, level_db: float | None) -> None:
    if level_db is None:
        msg = f"--adult: seen in fewer than {_MIN_ECHOES} windows, which tells no level"
        raise RadardError(msg)
    try:
        change(path, "settings", {"mount": {"level_db": level_db}})
    except ValueError as err:
        raise RadardError(f"--adult: {err}") from err
    sys.stderr.write(f"mount.level_db: {level_db:.1f}, an adult's level, is kept in {path}\n")


def line_of(step: WalkDecision) -> str:
    """Return the line of the log for one decision."""
    if step.over_floor_db is None:
        return f"{step.t_s:7.1f} s  window invalid: too many frames missing"
    head = f"{step.t_s:7.1f} s  {step.over_floor_db:+6.1f} dB  {bar(_share(step), _BAR)}"
    if step.range_m is None:
        return f"{head}  nothing"
    p_human = "" if step.p_human is None else f" {step.p_human:.2f}"
    alarm = "  ALARM" if step.alarm else ""
    return f"{head}  {step.range_m:4.1f} m  {step.label or 'moves'}{p_human}{alarm}"


def _share(step: WalkDecision) -> float:
    """Return how full the bar is: empty at the floor of the room."""
    return (step.over_floor_db or 0.0) / _FULL_DB


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
            line.show(f"[{bar(_share(step))}] {seen}; Ctrl-C ends the walk")
    except KeyboardInterrupt:
        # The way to end a walk: now comes the report.
        pass
    finally:
        line.clear()
    return steps, round(median(echoes), 1) if len(echoes) >= _MIN_ECHOES else None


def make_parser() -> Parser:
    parser = new_parser(
        "radard walktest",
        "Log what the radar sees while somebody walks; report it by range at the end.",
        _EXAMPLES,
    )
    add_options(parser, *LISTENING)
    add = parser.add_argument
    add("--duration", type=float, default=LONGEST_S, metavar="S", help="seconds (till Ctrl-C)")
    add("--adult", action="store_true", help="an adult walks: keep the level, so that size counts")
    add("--json", action="store_true", help="log and report as one JSON object at the end")
    return parser
