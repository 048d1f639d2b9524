"""What the studies share: the frame of a script, pictures, tables between the marks of a page."""

import argparse
import os
import platform
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

from matplotlib.figure import Figure

from radard.errors import UsageError
from x2radar.command import Parser, new_parser, run_command

Marks = tuple[str, str]
RESULTS: Marks = ("<!-- results -->", "<!-- end of results -->")
# The pages' tests heed this mark: results take minutes, or hours.
_NOT_RUN = "<!-- not run: minutes of simulation; tried with {} -->\n"


def script_parser(name: str, text: str, examples: str) -> Parser:
    """Return the parser of `research/NAME.py`; each example is what follows its name."""
    shown = "".join(f"  python research/{name}.py {each}\n" for each in examples.splitlines())
    return new_parser(f"research/{name}.py", text, f"examples:\n{shown}")


def run_script(
    parser: Parser, body: Callable[[argparse.Namespace], None], argv: Sequence[str] | None
) -> int:
    """Run a script's body and return its exit code; an error is one line, as with a command."""

    def run(words: Sequence[str]) -> int:
        body(parser.parse_args(words))
        return 0

    return run_command(parser.prog, run, argv)


def check_within(args: argparse.Namespace, **bounds: tuple[float, float]) -> None:
    """Raise UsageError if an option, named with its bounds, is out of them."""
    for name, (low, high) in bounds.items():
        if not low <= getattr(args, name) <= high:
            msg = f"--{name} {getattr(args, name):g}: must be {low:g} to {high:g}"
            raise UsageError(msg)


def check_picture(path: Path | None) -> None:
    """Raise UsageError unless a picture's file is a PNG, a PDF or an SVG."""
    if path is not None and path.suffix not in {".png", ".pdf", ".svg"}:
        msg = f"--plot {path}: must end in .png, .pdf or .svg"
        raise UsageError(msg)


def save(figure: Figure, path: Path, dpi: int) -> None:
    """Write a figure without a date: the same figures give the same file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=dpi, metadata={"Software": None} if path.suffix == ".png" else None)
    say(str(path))


def publish(path: Path, marks: Marks, table: Iterable[str], command: str, short: str) -> None:
    """Put a table and the command that made it into a page, in the place of what is there.

    `short` are options with which the pages' tests try the command. Raises UsageError if the page
    lacks the marks.
    """
    text = path.read_text("utf-8") if path.is_file() else ""
    before, begin, rest = text.partition(marks[0])
    _, end, behind = rest.partition(marks[1])
    if not begin or not end:
        msg = f"{path}: lacks the marks {marks[0]} and {marks[1]}"
        raise UsageError(msg)
    script = next(word for word in command.split() if word.endswith(".py"))
    mark = _NOT_RUN.format(f"{Path(script).name}: {short}")
    body = "\n".join(("", "", mark, f"    {command}", "", *table, "", ""))
    path.write_text(f"{before}{begin}{body}{end}{behind}", "utf-8")


def say(text: str) -> None:
    """Print a result."""
    sys.stdout.write(f"{text}\n")


def processor() -> str:
    """Return the processor's name, as far as the system tells it."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def one_thread() -> None:
    """Begin the script again in one thread, as the daemon runs, unless the environment says so."""
    if "OMP_NUM_THREADS" not in os.environ:
        # Libraries have read the variable by now.
        environ = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        os.execve(sys.executable, [sys.executable, *sys.argv], environ)  # noqa: S606
