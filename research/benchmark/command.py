"""`train-export benchmark`: entries on fixed tasks; yours, too."""

import argparse
import os
from pathlib import Path

from radard.errors import UsageError
from x2radar.commands import add_command
from x2train.commands import Commands, check_least, counted, progress, result_console

_EXAMPLES = """\
examples:
  train-export benchmark --data-only                 make the data, nothing else
  train-export benchmark                             every entry that comes along
  train-export benchmark --entry mine.py --tasks T1D60,T2D60
  train-export benchmark --entry mine.py:my_scores --elements 1000
  train-export benchmark --entry models/mine.onnx
  train-export benchmark --tasks accept-3 --share 0.1 --entry models/mine.onnx --entry mine.py
A run that was interrupted goes on where it was. docs/benchmark.md tells what counts.
"""


def register(commands: Commands) -> None:
    """Add the subcommand."""
    parser = add_command(commands, "benchmark", "fixed tasks, peers' methods and yours", _EXAMPLES)
    add = parser.add_argument
    add("--entry", action="append", metavar="NAME|FILE.py[:FUNCTION]|BUNDLE", help="repeatable")
    add("--tasks", metavar="LIST", help="of T1D60, T1D200, ..., T2C200 (all eight), or accept-3")
    add("--elements", type=int, default=5000, help="of a set, to train with (5000)")
    add("--fresh", type=int, default=5000, help="further ones that judge (5000)")
    add("--seed", type=int, default=0, help="of an entry's own draws (0)")
    add("--share", type=float, default=1.0, metavar="F", help="of accept-3's passages (1)")
    add("--folder", type=Path, default=Path("build/benchmark"), help="of data and scores")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes that simulate")
    add("--data-only", action="store_true", help="make the data")
    add("--kept", action="store_true", help="run nothing: the largest that earlier runs left")
    add("--publish", type=Path, metavar="FILE", help="page whose tables to replace")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_least(args, elements=40, fresh=40, seed=0, workers=1)
    # Late: torch takes seconds, and --help must not.
    from x2train.judge.acceptance import VERSION as ACCEPT  # noqa: PLC0415

    return _run_alarms(args) if args.tasks == ACCEPT else _run_elements(args)


def _run_elements(args: argparse.Namespace) -> int:
    from research.benchmark.entrants import entrant_named, shipped  # noqa: PLC0415
    from research.benchmark.results_page import RESULTS, publish, table  # noqa: PLC0415
    from research.benchmark.scoring import Kept, score  # noqa: PLC0415
    from research.benchmark.tasks import tasks_named  # noqa: PLC0415

    console = result_console()
    if args.kept:
        made_before = Kept(args.folder / "scores").largest(args.seed)
        console.print("\n".join(table(made_before)), markup=False)
        if args.publish:
            publish(args.publish, RESULTS, table(made_before), "train-export benchmark")
        return 0
    tasks = tasks_named(args.tasks, args.elements, args.fresh)
    entrants = [entrant_named(text) for text in args.entry or shipped()]
    data, kept = args.folder / "data", Kept(args.folder / "scores")
    with progress() as bar:
        row = bar.add_task("", total=1)

        def tell(what: str, done: int, total: int) -> None:
            bar.update(row, description=what, completed=done, total=max(total, 1))

        for task in tasks:
            task.make(data, tell, args.workers)
    if args.data_only:
        console.print(str(data))
        return 0
    scores = []
    for entrant in entrants:
        for task in tasks:
            key = entrant.kept_as
            made = kept.load(task, key, args.seed) if key else None
            if made is None:
                p = entrant.run(task, data, args.seed)
                about = (entrant.name, entrant.title)
                made = score(task, about, args.seed, p, task.test(data))
                kept.save(task, key or entrant.name, made)
            scores.append(made)
            console.print(f"{task.name} {entrant.name}: {100 * made.accuracy:.1f} %")
    console.print("\n".join(table(scores)), markup=False)
    if args.publish:
        size = f"--elements {args.elements} --fresh {args.fresh}"
        publish(args.publish, RESULTS, table(scores), _command(args, size))
    return 0


def _run_alarms(args: argparse.Namespace) -> int:
    from research.benchmark import acceptance_task as task  # noqa: PLC0415
    from research.benchmark.results_page import publish  # noqa: PLC0415

    if not 0 < args.share <= 1:
        msg = f"--share {args.share:g}: must be above 0, and 1 at most"
        raise UsageError(msg)
    entrants = [task.alarm_entrant(text) for text in args.entry or task.default_entries()]
    scores = []
    for entrant in entrants:
        with counted(entrant.title) as tell:
            made = task.play(entrant, args.folder, args.share, workers=args.workers, tell=tell)
        scores.append(made)
    lines = list(task.alarm_table(scores))
    result_console().print("\n".join(lines), markup=False)
    if args.publish:
        publish(args.publish, task.MARKS, lines, _command(args, f"--share {args.share:g}"))
    return 0


def _command(args: argparse.Namespace, size: str) -> str:
    words = ["train-export", "benchmark"]
    for entry in args.entry or ():
        words += ["--entry", entry]
    if args.tasks:
        words += ["--tasks", args.tasks]
    return " ".join([*words, size])
