"""What the three commands share: one-line errors, exit codes, the parser that keeps them."""

import argparse
import contextlib
import itertools
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn, TextIO

from x2radar.extras import DISTRIBUTION, install_hint
from x2radar.interrupts import interrupts

_EXTRAS = {"radard": "daemon", "train-export": "train"}
"""What pyproject.toml calls the packages that a command needs."""
Body = Callable[[Sequence[str]], int]
_OURS = ("x2radar", "radard", "x2train", "")


def legible(name: Path | str) -> str:
    """Return a file's name for texts in UTF-8: a byte that is none is shown as an escape."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, with the nearest word that it knows."""

    words: Sequence[str] = ()  # words that may stand first, where they are no choice of argparse's

    def error(self, message: str) -> NoReturn:
        """Print one line and end with exit code 2."""
        self.exit(2, f"{self.prog}: {' '.join(message.split())}; see {self.prog} --help\n")

    def parse_known_args(  # type: ignore[override] # one of typeshed's two overloads
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse; whatever is left over is an error of this parser, not of the one above it."""
        words = list(sys.argv[1:] if args is None else args)
        self._check_options(words)
        found, left = super().parse_known_args(words, namespace)
        if left:
            self._refuse(left, [*self.words, *self._option_string_actions])
        return found, left

    def _check_options(self, words: Sequence[str]) -> None:
        """Refuse an option that does not exist before argparse misses what it stood for."""
        if any(isinstance(action, argparse._SubParsersAction) for action in self._actions):
            return
        for word in itertools.takewhile(lambda word: word != "--", words):
            name = word.partition("=")[0]
            is_known = any(option.startswith(name) for option in self._option_string_actions)
            if word.startswith("--") and not is_known:
                self._refuse([word], self._option_string_actions)

    def _print_message(self, message: str, file: Any = None) -> None:
        if file is sys.stdout:
            # argparse would drop what goes wrong, such as a full disk.
            print(message, end="", flush=True)  # noqa: T201 - help is what was asked for
        else:
            _tell(message)

    def _refuse(self, left: Sequence[str], known: Iterable[str]) -> NoReturn:
        self.error(f"unrecognized arguments: {' '.join(left)}{nearest(left[0], known)}")

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        if not arg_string and action.choices is None:
            # As of a variable of the shell that is not set; Path would make the folder at hand.
            raise argparse.ArgumentError(action, "nothing is named")
        return super()._get_value(action, arg_string)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            hint = nearest(str(value), known) or f" (choose from {', '.join(known)})"
            raise argparse.ArgumentError(action, f"invalid choice: '{value}'{hint}")


def nearest(word: str, known: Iterable[str]) -> str:
    """Return what a message says after a word that is not known.

    >>> nearest("evnts", ["events", "explain"])
    "; did you mean 'events'?"
    >>> nearest("--prot=x", ["--port", "--help"])
    "; did you mean '--port'?"
    >>> nearest("horse", ["events", "explain"])
    ''
    """
    close = get_close_matches(word.partition("=")[0], known, 1)
    return f"; did you mean '{close[0]}'?" if close else ""


class StatusLine:
    """One line that changes while a command works, where a person watches `out`."""

    def __init__(self, out: TextIO) -> None:
        self.is_on = out.isatty()
        self._out = out
        self._width = 0

    def show(self, text: str) -> None:
        """Put `text` into the place of what stands there."""
        if self.is_on:
            self._out.write("\r" + text.ljust(self._width))
            self._out.flush()
            self._width = len(text)

    def clear(self) -> None:
        """Take the line away, before something else is printed."""
        if self._width:
            self.show("")
            self._out.write("\r")
            self._out.flush()


def bar(share: float, width: int = 30) -> str:
    """Return a bar of `width` characters, filled to `share`, which is kept in 0 to 1.

    >>> bar(0.3, 10)
    '###.......'
    """
    n = round(min(max(share, 0.0), 1.0) * width)
    return "#" * n + "." * (width - n)


def new_parser(prog: str, description: str, examples: str) -> Parser:
    """Return a parser with --version, --debug and examples at the end of its help."""
    parser = Parser(
        prog=prog,
        description=description,
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {installed_version()}")
    parser.add_argument("--debug", action="store_true", help="show a traceback with errors")
    return parser


def installed_version(distribution: str = DISTRIBUTION) -> str:
    """Return the version of an installed distribution, this one by default, or 'unknown'."""
    # Late: it loads much, and signals must be heard before.
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415

    try:
        return version(distribution)
    except PackageNotFoundError:
        return "unknown"


def run_command(
    prog: str, body: Body, argv: Sequence[str] | None = None, *, is_loaded: bool = True
) -> int:
    """Run a command's body; turn what it raises into one line and its `exit_code`, else 1."""
    args = list(sys.argv[1:] if argv is None else argv)
    try:
        with interrupts() if is_loaded else contextlib.nullcontext():
            code = body(args)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return 0
    except BrokenPipeError:
        # The reader of our output has gone, as with `| head`: nothing is left to say.
        _give_up(sys.stdout)
        return 0
    except Exception as err:  # noqa: BLE001 - the last line of defence of a command
        if isinstance(err.__context__, KeyboardInterrupt):
            # A compiled module that was being imported makes another error of it.
            return 0
        if "--debug" in args:
            traceback.print_exc()
        known = getattr(err, "exit_code", None)
        text = str(err) if known is not None else _missing_extra(prog, err)
        if isinstance(err, OSError) and err.strerror and not text:
            text = f"{err.filename or 'stdout'}: {err.strerror}"
            if not err.filename:
                _give_up(sys.stdout)
        if isinstance(err, MemoryError) or "start new thread" in str(err):
            text = "the system gives no more memory, or no more threads"
        text = text or f"internal error: {err!r}; --debug shows more"
        _tell(f"{prog}: {' '.join(text.split())}\n")
        return known if isinstance(known, int) else 1
    return code


def _tell(text: str) -> None:
    """Print to stderr; where that cannot be, the exit code still tells what went wrong."""
    try:
        sys.stderr.write(text)
        sys.stderr.flush()
    except OSError:
        _give_up(sys.stderr)


def _give_up(stream: TextIO) -> None:
    """Have what is still to be printed go nowhere: Python would say once more that it cannot."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _missing_extra(prog: str, err: BaseException) -> str:
    name = (getattr(err, "name", None) or "").partition(".")[0]
    if not isinstance(err, ModuleNotFoundError) or prog not in _EXTRAS or name in _OURS:
        return ""
    return f"needs {name}, which is not installed: {install_hint(_EXTRAS[prog])}"
