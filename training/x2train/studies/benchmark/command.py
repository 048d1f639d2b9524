"""`train-export benchmark`: entries on fixed tasks; yours, too."""

import argparse
import os
from pathlib import Path

from x2radar.commands import add_command
from x2train.commands import Commands, check_least, progress, result_console

_EXAMPLES = """\
examples:
  train-export benchmark --data-only                 make the data, nothing else
  train-export benchmark                             every entry that comes along
  train-export benchmark --entry mine.py --tasks T1D60,T2D60
  train-export benchmark --entry mine.py:my_scores --elements 1000
  train-export benchmark --entry models/mine.onnx
A run that was interrupted goes on where it was. docs/benchmark.md tells what counts.
"""


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(commands, "benchmark", "fixed tasks, peers' methods and yours", _EXAMPLES)
    add = parser.add_argument
    add("--entry", action="append", metavar="NAME|FILE.py[:FUNCTION]|BUNDLE", help="repeatable")
    add("--tasks", metavar="LIST", help="of T1D60, T1D200, ..., T2C200 (all eight)")
    add("--elements", type=int, default=5000, help="of a set, to train with (5000)")
    add("--fresh", type=int, default=5000, help="further ones that judge (5000)")
    add("--seed", type=int, default=0, help="of an entry's own draws (0)")
    add("--folder", type=Path, default=Path("build/benchmark"), help="of data and scores")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes that simulate")
    add("--data-only", action="store_true", help="make the data")
    add("--publish", type=Path, metavar="FILE", help="page whose tables to replace")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_least(args, elements=40, fresh=40, seed=0, workers=1)
    # Late: torch takes seconds, and --help must not.
    from x2train.studies.benchmark.entrants import entrant_named, shipped  # noqa: PLC0415
    from x2train.studies.benchmark.results_page import publish, table  # noqa: PLC0415
    from x2train.studies.benchmark.scoring import Kept, score  # noqa: PLC0415
    from x2train.studies.benchmark.tasks import tasks_named  # noqa: PLC0415

    tasks = tasks_named(args.tasks, args.elements, args.fresh)
    entrants = [entrant_named(text) for text in args.entry or shipped()]
    data, kept = args.folder / "data", Kept(args.folder / "scores")
    with progress() as bar:
        row = bar.add_task("", total=1)

        def tell(what: str, done: int, total: int) -> None:
            bar.update(row, description=what, completed=done, total=max(total, 1))

        for task in tasks:
            task.make(data, tell, args.workers)
    console = result_console()
    if args.data_only:
        console.print(str(data))
        return 0
    scores = []
    for entrant in entrants:
        for task in tasks:
            made = kept.load(task, entrant.name, args.seed)
            # Only what comes along is known to be what it was.
            if made is None or entrant.name not in shipped():
                p = entrant.run(task, data, args.seed)
                about = (entrant.name, entrant.title)
                made = score(task, about, args.seed, p, task.test(data))
                kept.save(task, made)
            scores.append(made)
            console.print(f"{task.name} {entrant.name}: {100 * made.accuracy:.1f} %")
    console.print("\n".join(table(scores)), markup=False)
    if any(entrant.is_bundle for entrant in entrants):
        console.print("train-export accept --model NAME judges a bundle as an alarm")
    if args.publish:
        publish(args.publish, scores, _command(args))
    return 0


def _command(args: argparse.Namespace) -> str:
    words = ["train-export", "benchmark"]
    for entry in args.entry or ():
        words += ["--entry", entry]
    if args.tasks:
        words += ["--tasks", args.tasks]
    return " ".join([*words, "--elements", str(args.elements), "--fresh", str(args.fresh)])
