"""`radard calibrate`: learn what an empty room looks like, and keep it for the gate."""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from radard.config.config import Config
from radard.config.directories import calibration_file, for_service
from radard.config.options import LISTENING, LONGEST_S, add_options, check_limits, listening_config
from radard.detect.calibration import Calibration, load_calibration
from radard.detect.gate import DAY_S
from radard.detect.survey import RoomSurvey
from radard.errors import RadardError, UsageError
from radard.run.components import Listening, listen
from radard.run.room_calibration import origin_of
from radard.stream.ring import Notice
from x2radar.command import Parser, StatusLine, bar, new_parser

_ABOUT = "Listen to the empty room: its noise over range, and thresholds that suit it."
_EXAMPLES = """\
examples:
  radard calibrate --port /dev/ttyACM0 --delay 30      leave it meanwhile
  radard calibrate --port /dev/ttyACM0 --with-machines the fan belongs there
  radard calibrate --port sim:empty --speed max --out empty.json
"""
_MIN_S = 25.0  # of listening: `MIN_INDEPENDENT` dwells and some more
_CELL_M = 0.5  # of the report


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    check_limits(args, duration=(_MIN_S, LONGEST_S), delay=(0, LONGEST_S))
    check_limits(args, false_gates=(1e-9, DAY_S))
    config = listening_config(args)
    if args.out is None and config.sensor.kind in {"sim", "replay"}:
        raise UsageError("--out FILE: needed; only a real radar's calibration is kept as its own")
    path = args.out or for_service(config, calibration_file(config))
    if path.exists():
        # Else it is somebody's recording, or configuration.
        load_calibration(path)
    with listen(config) as listening:
        survey = _surveyed(listening, config, args)
        survey.check_empty(takes_machines=args.with_machines)
        stream, classifier = listening.pipeline.stream, listening.pipeline.classifier
        origin = origin_of(stream, classifier, config.sensor.port or "")
        calibration = survey.calibration(origin, false_gates_per_day=args.false_gates)
    # What was saved is what will hold, so the report is made of the same.
    calibration.save(path)
    if args.json:
        print(json.dumps({"file": str(path), **json.loads(calibration.text())}))
    else:
        print("\n".join(report(calibration, path, is_own=args.out is None)))
    return 0


def report(calibration: Calibration, path: Path, *, is_own: bool) -> Iterator[str]:
    """Yield lines: the noise map by half metres, its promise, where it is (`is_own`: known)."""
    made = calibration.provenance
    yield f"{made.device}, {made.duration_s:.0f} s, {made.n_dwells} windows, {made.made_utc}"
    yield ""
    yield "range          noise floor   gate threshold"
    n_range = len(calibration.floor)
    range_m = calibration.range_offset_m + calibration.bin_length_m * np.arange(n_range)
    cells = np.floor(range_m / _CELL_M)
    for cell in np.unique(cells):
        here = cells == cell
        floor = calibration.floor[here].mean()
        level = f"{10 * np.log10(floor):8.1f} dB" if floor > 0 else "       dead"
        low, high = calibration.threshold_db[here].min(), calibration.threshold_db[here].max()
        span = f"{cell * _CELL_M:4.1f} to {(cell + 1) * _CELL_M:4.1f} m"
        yield f"{span}   {level}   {low:5.1f} to {high:.1f} dB over it"
    yield ""
    rate = made.false_gates_per_day
    often = "less than one in 1000 days" if rate < 1e-3 else f"{rate:.2g} a day"
    yield f"predicted false gates: {often} in such a room"
    yield f"kept in {path}"
    if not is_own:
        yield f"use it: gate.calibration: {path}"


def _surveyed(listening: Listening, config: Config, args: argparse.Namespace) -> RoomSurvey:
    survey = RoomSurvey(config.gate, listening.pipeline.shape.hop_s)
    line = StatusLine(sys.stderr)
    for item in listening.dwells(args.duration, skip_s=args.delay):
        if isinstance(item, Notice):
            raise RadardError(f"the stream broke off ({item.reason}): calibrate again")
        moves = survey.add(item)
        told = f"{survey.n_dwells} windows" + (", something moves" if moves else "")
        share = survey.n_dwells * config.decision.hop_s / args.duration
        line.show(f"[{bar(share)}] {told}")
    line.clear()
    return survey


def make_parser() -> Parser:
    parser = new_parser("radard calibrate", _ABOUT, _EXAMPLES)
    add_options(parser, *LISTENING)
    add = parser.add_argument
    add("--duration", type=float, default=60.0, metavar="S", help="seconds to listen (60)")
    add("--delay", type=float, default=0.0, metavar="S", help="seconds to leave the room (0)")
    add("--out", type=Path, metavar="FILE", help="instead of the state directory")
    text = "windows a day that may open the gate (1)"
    add("--false-gates", type=float, default=1.0, metavar="N", help=text)
    text = "what stays in one place is no reason to stop"
    add("--with-machines", action="store_true", help=text)
    add("--json", action="store_true", help="the calibration as one JSON object")
    return parser
