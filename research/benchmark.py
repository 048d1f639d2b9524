"""A benchmark that others can enter: fixed tasks, methods of peers and yours."""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import benchmark_alarms as alarms
from benchmark_tasks import FULL, SEED, Kept, Score, entrant_named, score, shipped, tasks_named
from study import RESULTS, check_within, publish, run_script, say, script_parser
from x2train.commands import counted, progress, stages
from x2train.judge.acceptance import VERSION as ACCEPT
from x2train.thesis.recipe import StudyRecipe

_EXAMPLES = """\
--data-only                 make the data, nothing else
                            every entry that comes along
--entry mine.py --tasks T1D60,T2D60
--entry mine.py:my_scores --elements 1000
--entry models/mine.onnx
--tasks accept-3 --share 0.1 --entry models/mine.onnx --entry mine.py"""
_SHORT = "--share 0.01 --elements 80 --fresh 40 --folder build --workers 1"


def main(argv: Sequence[str] | None = None) -> int:
    """Run entries on tasks; a run that was interrupted goes on where it was."""
    parser = script_parser("benchmark", "Fixed tasks, peers' methods and yours.", _EXAMPLES)
    add = parser.add_argument
    add("--entry", action="append", metavar="NAME|FILE.py[:FUNCTION]|BUNDLE", help="repeatable")
    add("--tasks", metavar="LIST", help="of T1D60, T1D200, ..., T2C200 (all eight), or accept-3")
    add("--elements", type=int, default=FULL, help=f"of a set, to train with ({FULL})")
    add("--fresh", type=int, default=FULL, help=f"further ones that judge ({FULL})")
    add("--seed", type=int, default=0, help="of an entry's own draws (0)")
    add("--share", type=float, default=1.0, metavar="F", help="of accept-3's passages (1)")
    add("--folder", type=Path, default=Path("build/benchmark"), help="of data and scores")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes that simulate")
    add("--data-only", action="store_true", help="make the data")
    add("--kept", action="store_true", help="run nothing: the largest that earlier runs left")
    add("--publish", type=Path, metavar="FILE", help="page whose tables to replace")
    return run_script(parser, _run, argv)


def _run(args: argparse.Namespace) -> None:
    check_within(args, share=(1e-6, 1), seed=(0, 2**31), workers=(1, 1e4))
    if args.tasks == ACCEPT:
        marks, size = alarms.MARKS, f"--share {args.share:g}"
        lines = _alarm_lines(args)
    else:
        marks, size = RESULTS, f"--elements {args.elements} --fresh {args.fresh}"
        lines = _element_lines(args)
    say("\n".join(lines))
    if args.publish and not args.data_only:
        words = ["python", "research/benchmark.py"]
        for entry in args.entry or ():
            words += ["--entry", entry]
        words += ["--tasks", args.tasks] if args.tasks else []
        words += [] if args.kept else [size]
        publish(args.publish, marks, lines, " ".join(words), _SHORT)


def _alarm_lines(args: argparse.Namespace) -> list[str]:
    scores = []
    for entrant in map(alarms.alarm_entrant, args.entry or alarms.default_entries()):
        with counted(entrant.title) as tell:
            made = alarms.play(entrant, args.folder, args.share, workers=args.workers, tell=tell)
        scores.append(made)
    return list(alarms.alarm_table(scores))


def _element_lines(args: argparse.Namespace) -> list[str]:
    kept = Kept(args.folder / "scores")
    if args.kept:
        return list(table(kept.largest(args.seed)))
    tasks = tasks_named(args.tasks, args.elements, args.fresh)
    entrants = [entrant_named(text) for text in args.entry or shipped()]
    with progress() as bar:
        tell = stages(bar)
        for task in tasks:
            sizes = {"n_elements": args.elements, "n_fresh": args.fresh, "workers": args.workers}
            StudyRecipe(folder=args.folder, seed=SEED, **sizes).make(task.spec, task.cell, tell)
    if args.data_only:
        return [str(args.folder / "data")]
    scores = []
    for entrant in entrants:
        for task in tasks:
            key = entrant.kept_as
            made = kept.load(task, key, args.seed) if key else None
            if made is None:
                p = entrant.run(task, args.folder, args.seed)
                made = score(task, entrant, args.seed, p, task.test(args.folder))
                kept.save(task, key or entrant.name, made)
            scores.append(made)
            say(f"{made.task} {entrant.name}: {100 * made.accuracy:.1f} %")
    return list(table(scores))


def table(scores: Sequence[Score]) -> Iterator[str]:
    """Yield the lines of the tables of elements."""
    most = max((s.n_train, s.n_test) for s in scores)
    size = f"{most[0]} elements to train with, {most[1]} fresh ones that judge"
    small = "" if most[0] >= FULL else f"; **small: the full task has {FULL} of each**"
    yield f"Version `{scores[0].version}`, {size}{small}."
    yield ""
    tasks = list(dict.fromkeys(s.task for s in scores))
    by_entry = {
        (s.entry, s.title): {each.task: each for each in scores if each.entry == s.entry}
        for s in scores
    }
    yield f"| accuracy in per cent | {' | '.join(tasks)} | mean |"
    yield f"|---|{'---|' * (len(tasks) + 1)}"
    for (entry, title), own in by_entry.items():
        cells = [f"{100 * own[task].accuracy:.1f}" if task in own else "" for task in tasks]
        mean = sum(s.accuracy for s in own.values()) / len(own)
        first = next(iter(own.values()))
        its = first.n_train, first.n_test
        less = "" if its == most else f", with {its[0]} and {its[1]} elements"
        yield f"| {title} (`{entry}`){less} | {' | '.join(cells)} | {100 * mean:.1f} |"
    yield ""
    widths = {
        n: max((s.high - s.low) / 2 for s in scores if s.n_test == n)
        for n in sorted({s.n_test for s in scores}, reverse=True)
    }
    told = ", ".join(f"±{100 * widest:.1f} points with {n}" for n, widest in widths.items())
    yield f"The 95 % interval of each figure is at most {told} that judge (Clopper-Pearson)."
    yield ""
    yield "| | mean AUC | mean cross-entropy, nats | mean accuracy of those in view |"
    yield "|---|---|---|---|"
    for (_, title), own in by_entry.items():
        rows = [(s.auc, s.cross_entropy, s.accuracy_in_view) for s in own.values()]
        auc, entropy, seen = (sum(column) / len(rows) for column in zip(*rows, strict=True))
        yield f"| {title} | {auc:.3f} | {entropy:.3f} | {100 * seen:.1f} |"


if __name__ == "__main__":
    sys.exit(main())
