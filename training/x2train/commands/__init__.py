"""Subcommands of `train-export`: each file registers one."""

import argparse
from collections.abc import Iterator
from typing import TypeAlias, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"
_T = TypeVar("_T")


def result_console() -> Console:
    """Return the console for results, on stdout: a line stays one line, a path what it is.

    rich would break lines at 80 columns where stdout is no terminal, within a path if need be,
    and take what stands in brackets for a style.
    """
    return Console(soft_wrap=True, highlight=False, markup=False)


def progress() -> Progress:
    """Return a bar on stderr: what, how far, of how much, time left."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
    )


def last(steps: Iterator[int | _T], total: int, text: str) -> _T:
    """Run a generator of counts behind a bar; return the result that it ends with."""
    result: _T | None = None
    with progress() as bar:
        task = bar.add_task(text, total=total)
        for step in steps:
            if isinstance(step, int):
                bar.update(task, completed=step)
            else:
                result = step
    assert result is not None  # noqa: S101 - generators end with their result
    return result
