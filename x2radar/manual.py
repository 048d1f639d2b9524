"""Man page and shell completion of a command, made from its parser, so that neither can be old."""

import argparse
import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from x2radar.command import Parser, installed_version
from x2radar.extras import DISTRIBUTION, needed

SHELLS = ("bash", "zsh")  # of those that shtab writes for; its tcsh leaves most options out
EXIT_CODES = {
    0: "clean, also after SIGINT and SIGTERM",
    1: "runtime failure",
    2: "usage",
    3: "device lost, with --on-device-loss quit",
    4: "the model does not fit the stream, or is not what its sidecar says",
    66: "port, input or bundle missing or unreadable",
    77: "no permission",
    78: "configuration",
}
"""Of the three commands; docs/troubleshooting.md says what to do."""
_ROFF = str.maketrans(
    {"\\": "\\e", "-": "\\-", "~": "\\(ti", "^": "\\(ha", "'": "\\(aq", "`": "\\(ga"}
)
"""Signs that roff would print otherwise (groff_char(7))."""
_WIDTH = 73  # man indents by seven


def add_manual(parser: Parser, whole: Callable[[], Parser] | None = None) -> None:
    """Add --print-man and --print-completion; `whole` makes the parser of all subcommands."""
    add = partial(parser.add_argument, action=_Print, const=whole)
    add("--print-man", nargs=0, help="print the man page and exit")
    text = "print a script that completes this command, and exit"
    add("--print-completion", choices=SHELLS, help=text)


def man_page(parser: argparse.ArgumentParser) -> str:
    """Return the page of a command for man(1): its help and that of all its subcommands."""
    about = (parser.description or "").rstrip(".")
    lines = [
        f'.TH {parser.prog.upper()} 1 "" "{DISTRIBUTION} {installed_version()}"',
        *(".SH NAME", f"{parser.prog} \\- {_plain(about)}", ".SH DESCRIPTION"),
        *_helps(parser),
        ".SH EXIT STATUS",
    ]
    for code, words in EXIT_CODES.items():
        lines += [".TP", f".B {code}", _plain(words)]
    return "\n".join(lines) + "\n"


def completion(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return the script of one of `SHELLS`; MissingExtra without shtab."""
    script: str = needed("shtab", what="shell completion").complete(parser, shell=shell)
    return script


def subparsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of the subcommands by name, without those of the next level."""
    return {
        name: sub
        for action in parser._actions
        if isinstance(action, argparse._SubParsersAction)
        for name, sub in action.choices.items()
    }


class _Print(argparse.Action):
    """Print the man page, or completion for a shell where one is given, and end."""

    def __call__(self, parser: argparse.ArgumentParser, *given: Any) -> None:
        """Print, of the parser that `const` makes, if this one is not whole."""
        whole = self.const() if self.const else parser
        text = completion(whole, given[1]) if self.nargs is None else man_page(whole)
        print(text, end="")  # noqa: T201 - what was asked for
        parser.exit()


def _helps(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the help of a command, then those of its subcommands."""
    # The same in a terminal of any width.
    parser.formatter_class = partial(argparse.RawDescriptionHelpFormatter, width=_WIDTH)
    yield from (f".SS {_plain(parser.prog)}", ".nf", _plain(parser.format_help()), ".fi")
    for sub in subparsers(parser).values():
        yield from _helps(sub)


def _plain(text: str) -> str:
    """Return text that roff prints as it is."""
    return re.sub(r"^\.", r"\\&.", text.translate(_ROFF), flags=re.MULTILINE)
