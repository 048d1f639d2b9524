"""`train-export levers`: what each setting costs in misses, false alarms, time and CPU."""

import argparse
from pathlib import Path

from radard.judge.bundle import load_bundle
from x2radar.commands import add_command
from x2train.commands import Commands, check_least, last, result_console


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands,
        "levers",
        "measure what frame rate, mount, waiting, hop and bundle cost",
        "example:\n  train-export levers --passages 100\n",
    )
    add = parser.add_argument
    add("--passages", type=int, default=100, help="people, and as many pets, in every row (100)")
    add(
        "--models",
        nargs="+",
        default=["accurate", "balanced", "fast"],
        metavar="NAME",
        help="bundles; the first is the usual one (accurate balanced fast)",
    )
    add("--page", type=Path, metavar="FILE", help="a page whose results are replaced")
    add("--plot", type=Path, metavar="FILE", help="PNG")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_least(args, passages=1)
    # Late: the simulator and matplotlib take a second, and --help must not.
    from research.benchmark.results_page import RESULTS, publish  # noqa: PLC0415
    from research.levers.cases import cases  # noqa: PLC0415
    from research.levers.measure import measure, n_played  # noqa: PLC0415
    from research.levers.page import draw, table  # noqa: PLC0415

    for name in args.models:
        load_bundle(name)
    rows = tuple(cases(tuple(args.models)))
    figures = last(measure(rows, args.passages), n_played(rows, args.passages), "passages")
    lines = list(table(figures, args.passages))
    console = result_console()
    for line in lines:
        console.print(line)
    models = " ".join(args.models)
    command = f"train-export levers --passages {args.passages} --models {models}"
    if args.page:
        publish(args.page, RESULTS, lines, command)
    if args.plot:
        draw(figures, args.plot)
        console.print(str(args.plot))
    return 0
