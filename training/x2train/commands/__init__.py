"""Subcommands of `train-export`: each file registers one."""

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from radard.errors import UsageError

if TYPE_CHECKING:
    from x2train.nets.epoch import Epoch

Commands: TypeAlias = "argparse._SubParsersAction[Any]"
_T = TypeVar("_T")


def check_least(args: argparse.Namespace, **least: int) -> None:
    """Raise UsageError if an argument is below its least value."""
    for name, value in least.items():
        if getattr(args, name) < value:
            msg = f"--{name} {getattr(args, name)}: must be at least {value}"
            raise UsageError(msg)


def sets_of(args: argparse.Namespace) -> str:
    """Return `--train` and `--validate` as they were given, for a card."""
    return " ".join(
        f"--{name} {' '.join(str(p) for p in getattr(args, name))}"
        for name in ("train", "validate")
    )


def tell_bundle(path: Path, metrics: Mapping[str, object], more: str = "") -> None:
    """Say which bundle was written, by its path without suffix, and what it achieves."""
    console = result_console()
    console.print(f"wrote {path}.onnx, .json and .md{more}")
    for key, value in metrics.items():
        console.print(f"  {key}: {value}")


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


def followed(steps: "Iterator[Epoch | _T]", epochs: int) -> _T:
    """Run a training behind a bar; return what it ends with."""
    # Late: torch takes seconds, and --help must not.
    from x2train.nets.epoch import Epoch  # noqa: PLC0415

    result: _T | None = None
    with progress() as bar:
        task = bar.add_task("train", total=epochs)
        for step in steps:
            if not isinstance(step, Epoch):
                result = step
                continue
            text = f"loss {step.loss:.3f}, validation {step.validation_loss:.3f}"
            bar.update(task, completed=step.number, description=f"train ({text})")
            if not bar.console.is_terminal:
                # A log has no use for a bar, and an epoch takes minutes.
                bar.console.print(f"epoch {step.number} of {epochs}: {text}")
    assert result is not None  # noqa: S101 - trainings end with their result
    return result
