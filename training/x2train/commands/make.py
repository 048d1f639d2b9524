"""`train-export make`: a shipped bundle from nothing, its sets included."""

import argparse
import os
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from radard.errors import UsageError
from x2radar.commands import add_command
from x2train.bundle.recipes import MOTION, RECIPES, arguments
from x2train.commands import Commands, check_least, result_console

_DATASET = "dataset"


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "make",
        "make a shipped bundle from nothing, sets included",
        "examples:\n"
        "  train-export make accurate --motion clips\n"
        "  train-export make fast --share 0.01 --out /tmp/models    to try it\n",
    )
    parser.description = (
        "Make a shipped bundle from nothing: its sets in sets/, then the bundle, by the "
        "commands of its card. Sets that are there are kept, one that was begun is "
        "finished, so what was stopped goes on. While a network trains on one core, the "
        "others make the sets of later steps."
    )
    add = parser.add_argument
    add("name", choices=sorted(RECIPES), help="of the bundle")
    add("--out", type=Path, default=Path("models"), help="folder of the bundle (models)")
    add("--motion", type=Path, metavar="DIR", help="a folder of clips, to learn from as well")
    add("--share", type=float, default=1.0, help="of the passages, to try it (1)")
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes (all cores)")
    add("--sets", action="store_true", help="make its sets and stop")
    add("--show", action="store_true", help="print the commands and do nothing")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    check_least(args, workers=1)
    if not 0 < args.share <= 1:
        raise UsageError(f"--share {args.share:g}: must be over 0, 1 at most")
    steps = arguments(
        args.name, share=args.share, workers=args.workers, models=args.out, motion=args.motion
    )
    if args.sets:
        steps = [step for step in steps if step[0] == _DATASET]
    if args.show:
        print("\n".join(f"train-export {shlex.join(step)}" for step in steps))  # noqa: T201
        return 0
    if any(MOTION in step for step in steps):
        msg = f"make {args.name}: needs --motion, a folder of clips; see train-export motion"
        raise UsageError(msg)
    console = result_console(stderr=True)
    for number, step in enumerate(steps, 1):
        console.print(f"[{number}/{len(steps)}] train-export {shlex.join(step)}")
        has_sets_to_come = any(each[0] == _DATASET for each in steps[number:])
        is_idle = args.workers > 1 and step[0] != _DATASET
        with _sets_beside(args) if is_idle and has_sets_to_come else nullcontext():
            code: int = args.train_export(step)
        if code:
            return code
    return 0


@contextmanager
def _sets_beside(args: argparse.Namespace) -> Iterator[None]:
    """Make sets of later steps on the other cores; what it leaves undone, these steps do."""
    share, workers = str(args.share), str(args.workers - 1)
    argv = ["make", args.name, "--sets", "--share", share, "--workers", workers]
    argv += ["--motion", str(args.motion)] if args.motion else []
    beside = subprocess.Popen(  # noqa: S603 - this program
        [sys.executable, "-m", "x2train", *argv],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
        beside.wait()
    finally:
        beside.terminate()
        beside.wait()
