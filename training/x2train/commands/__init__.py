"""Subcommands of `train-export`: each file registers one. Here is what several of them need.

They import torch, the simulator and what needs them when they run: `--help` must not wait.
"""

import argparse
import os
import shlex
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from radard.errors import UsageError
from x2train.nets.calibration import Epoch
from x2train.sets.workers import Crew, Tell

Commands: TypeAlias = "argparse._SubParsersAction[Any]"
_T = TypeVar("_T")
_LOG_EVERY_S = 30.0  # between lines where stderr is no terminal but a log: two a minute


def check_least(args: argparse.Namespace, **least: int) -> None:
    """Raise UsageError if an argument is below its least value."""
    for name, value in least.items():
        if getattr(args, name) < value:
            raise UsageError(f"--{name} {getattr(args, name)}: must be at least {value}")


def told(args: argparse.Namespace, always: str, **unless: Any) -> str:
    """Return options as they were given, for a card; some of them unless they are as here."""
    words: list[str] = []
    for name in [*always.split(), *unless]:
        value = getattr(args, name)
        if name not in unless or value != unless[name]:
            several = [] if value is True else value if isinstance(value, list) else [value]
            words += [f"--{name.replace('_', '-')}"]
            words += [f"{v:g}" if isinstance(v, float) else str(v) for v in several]
    return shlex.join(words)


def tell_bundle(path: Path, metrics: Mapping[str, object]) -> None:
    """Say which bundle was written, by its path without suffix, and what it achieves."""
    console = result_console()
    console.print(f"wrote {path}.onnx, .json and .md")
    for key, value in metrics.items():
        console.print(f"  {key}: {value}")


def result_console(*, stderr: bool = False) -> Console:
    """Return the console for results, on stdout: a line stays one line, a path what it is."""
    return Console(stderr=stderr, soft_wrap=True, highlight=False, markup=False)


def progress() -> Progress:
    """Return a bar on stderr: what, how far, of how much, time left; none where it is a log."""
    console = result_console(stderr=True)
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def stages(bar: Progress) -> Callable[[str, int, int], None]:
    """Return what tells of one thing after another: what is done, how far, of how much."""
    task = bar.add_task("", total=1)

    def tell(what: str, done: int, total: int) -> None:
        bar.update(task, description=what, completed=done, total=max(total, 1))

    return tell


@contextmanager
def counted(text: str) -> Iterator[Tell]:
    """Yield what shows progress: a bar, or a line now and then where stderr is a log."""
    with progress() as bar:
        task = bar.add_task(text, total=None)
        next_s = time.monotonic() + _LOG_EVERY_S

        def tell(done: int, total: int) -> None:
            nonlocal next_s
            bar.update(task, completed=done, total=total)
            if not bar.console.is_terminal and time.monotonic() >= next_s:
                next_s = time.monotonic() + _LOG_EVERY_S
                bar.console.print(f"{text}: {done:,} of {total:,}")

        yield tell


def add_crew(parser: argparse.ArgumentParser) -> None:
    """Add the options that say who makes a set."""
    add = parser.add_argument
    add("--workers", type=int, default=os.cpu_count() or 1, help="processes (all cores)")
    add("--cluster", metavar="ADDRESS", help="a Dask scheduler, instead of processes")


@contextmanager
def crew_of(args: argparse.Namespace) -> Iterator[Crew]:
    """Yield who makes passages, with what shows how far they are."""
    with counted("passages") as tell:
        yield Crew(args.workers, args.cluster, tell)


def followed(steps: Iterator[Epoch | _T], epochs: int) -> _T:
    """Run a training behind a bar; return what it ends with. A log gets a line an epoch."""
    with progress() as bar:
        task = bar.add_task("train", total=epochs)
        while isinstance(step := next(steps), Epoch):
            text = f"loss {step.loss:.3f}"
            if step.validation_loss is not None:
                text += f", validation {step.validation_loss:.3f}"
            bar.update(task, completed=step.number, description=f"train ({text})")
            if not bar.console.is_terminal:
                bar.console.print(f"epoch {step.number} of {epochs}: {text}")
    return step
