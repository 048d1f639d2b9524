"""`train-export walks`: the recorded walk of a person beside simulated ones."""

import argparse
from pathlib import Path

from radard.errors import UsageError
from x2radar.commands import add_command
from x2train.commands import Commands, last, result_console

_MOST_FILES = 2  # modules 101 and 102


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(
        commands,
        "walks",
        "compare simulated walkers with the two recorded P4xx walks",
        "example:\n  train-export walks p410_walk_101.mat p410_walk_102.mat --out walks/\n",
    )
    add = parser.add_argument
    add("files", nargs="+", type=Path, metavar="FILE", help="recordings, 101 first")
    add("--out", type=Path, required=True, metavar="DIR", help="where scene_walks.png goes")
    add("--seeds", type=int, default=12, metavar="N", help="simulated people (12)")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    # Late: matplotlib takes a second, and --help must not.
    from research.walks.comparison import Comparison, compare  # noqa: PLC0415
    from research.walks.plot import plot_walks  # noqa: PLC0415

    if len(args.files) > _MOST_FILES:
        msg = f"{len(args.files)} files: the walk was recorded by {_MOST_FILES} radars"
        raise UsageError(msg)
    if not 2 <= args.seeds <= 1000:
        msg = f"--seeds {args.seeds}: must be 2 to 1000"
        raise UsageError(msg)
    found: Comparison = last(compare(args.files, args.seeds), args.seeds, "people")
    console = result_console()
    console.print(found.table())
    console.print("* not within 20 %, or 2 dB")
    console.print(str(plot_walks(found, args.out / "scene_walks.png")))
    return 0
