"""What the three commands share: one-line errors, exit codes, the parser that keeps them.

0 clean, also after SIGINT and SIGTERM; 1 runtime failure; 2 usage; further codes stand in
the `exit_code` of the errors themselves.
"""

import argparse
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from typing import NoReturn, TextIO

from x2radar.distribution import DISTRIBUTION, install_hint

_EXTRAS = {"radard": "daemon", "train-export": "train"}
"""What pyproject.toml calls the packages that a command needs."""
_OURS = ("x2radar", "radard", "x2train")


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Print one line and end with exit code 2."""
        self.exit(2, f"{self.prog}: {' '.join(message.split())}; see {self.prog} --help\n")


class StatusLine:
    """One line that changes while a command works, where a person watches; silence elsewhere.

    `out` is usually stderr: stdout carries data only.
    """

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


def installed_version() -> str:
    """Return the version of the installed distribution, or 'unknown'."""
    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:
        return "unknown"


def run_command(
    prog: str, body: Callable[[Sequence[str]], int], argv: Sequence[str] | None = None
) -> int:
    """Run a command's body and turn what it raises into one line and an exit code.

    `argv` are the process' own arguments by default.
    """
    args = list(sys.argv[1:] if argv is None else argv)
    try:
        with _sigterm_interrupts():
            code = body(args)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return 0
    except BrokenPipeError:
        # The reader of our output has gone, as with `| head`: nothing is left to say.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as err:  # noqa: BLE001 - the last line of defence of a command
        if "--debug" in args:
            traceback.print_exc()
        known = getattr(err, "exit_code", None)
        text = str(err) if known is not None else _missing_extra(prog, err)
        text = text or f"internal error: {err!r}; --debug shows more"
        print(f"{prog}: {' '.join(text.split())}", file=sys.stderr)  # noqa: T201 - the one line
        return known if isinstance(known, int) else 1
    return code


def import_fault(err: ModuleNotFoundError, *, prog: str) -> BaseException:
    """Return what to raise instead of `err` where a command's own imports fail.

    One line that names the extra, and exit code 1, when a package of that extra is missing.
    """
    text = _missing_extra(prog, err)
    return SystemExit(f"{prog}: {text}") if text else err


def _missing_extra(prog: str, err: BaseException) -> str:
    extra = _EXTRAS.get(prog)
    if extra is None or not isinstance(err, ModuleNotFoundError) or not err.name:
        return ""
    name = err.name.partition(".")[0]
    if name in _OURS:
        return ""
    return f"needs {name}, which is not installed: {install_hint(extra)}"


@contextmanager
def _sigterm_interrupts() -> Iterator[None]:
    """Let SIGTERM end a command as SIGINT does, where nobody else has a say in it."""
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
