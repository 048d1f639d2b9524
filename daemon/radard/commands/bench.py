"""`radard bench`: how many radars this machine carries."""

import json
import os
from collections.abc import Sequence

from radard.commands.bench_stages import Cost, measured
from radard.commands.offline_stream import add_listening, check_seconds, listening_config
from radard.errors import UsageError
from x2radar.command import Parser, new_parser

_EXAMPLES = """\
examples:
  radard bench                         the shipped model, 60 frames a second
  radard bench --port 'sim:human?rate=200' --model none
  radard bench --port replay:night.h5 --json
"""
_SPARE = 0.7  # of the cores that radars may take; chosen


def run(argv: Sequence[str]) -> int:
    """Run the subcommand."""
    args = make_parser().parse_args(argv)
    check_seconds("--duration", args.duration, 4.0)
    if not 1 <= args.rounds <= 100:
        msg = f"--rounds {args.rounds}: must be 1 to 100"
        raise UsageError(msg)
    config = listening_config(args, default_port="sim:human")
    cost = measured(config, args.duration, args.rounds)
    n_cores = len(os.sched_getaffinity(0))
    n_radars = int(_SPARE * n_cores / cost.all_s)
    if args.json:
        rows = [
            {"stage": s.name, "cpu_s_per_stream_s": s.cpu_s, "times_reference": s.ratio}
            for s in cost.stages
        ]
        about = {"frame_rate_hz": cost.frame_rate_hz, "model": cost.model, "cores": n_cores}
        print(json.dumps({**about, "stages": rows, "radars": n_radars}))
        return 0
    print(f"{config.sensor.port}: {cost.frame_rate_hz:g} frames a second, model {cost.model}")
    print(f"{cost.duration_s:.0f} s of it, {args.rounds} rounds, medians\n")
    print(f"{'':<34}{'CPU ms per':>12}{'of one':>9}{'times the':>11}")
    print(f"{'':<34}{'stream s':>12}{'core':>9}{'reference':>11}")
    for stage in cost.stages:
        share = f"{100 * stage.cpu_s:.1f} %"
        print(f"{stage.name:<34}{1e3 * stage.cpu_s:12.1f}{share:>9}{stage.ratio:11.2f}")
    print(f"\nreference: {cost.reference}")
    print("worst case: a gate that is always open; outputs, clips and the port are not in it")
    print(_verdict(cost, n_cores, n_radars))
    return 0


def _verdict(cost: Cost, n_cores: int, n_radars: int) -> str:
    cores = "1 core" if n_cores == 1 else f"{n_cores} cores"
    if n_radars < 1:
        need = f"{100 * cost.all_s:.0f} % of a core"
        return f"this machine ({cores}) does not carry one radar with 30 % to spare: {need} each"
    return f"this machine ({cores}) carries {n_radars} such radars, with 30 % to spare"


def make_parser() -> Parser:
    """Return the parser of the subcommand."""
    parser = new_parser(
        "radard bench", "Measure what one radar costs, and so how many fit.", _EXAMPLES
    )
    add_listening(parser)
    add = parser.add_argument
    add("--duration", type=float, default=15.0, metavar="S", help="seconds of stream (15)")
    add("--rounds", type=int, default=5, metavar="N", help="measurements of each (5)")
    add("--json", action="store_true", help="one JSON object")
    return parser
