"""Man page and shell completion of a command, made from its parser, so that neither can be old.

`add_manual` adds --print-man and --print-completion. `whole` is the parser with all subcommands,
where the command itself parses them one by one.
"""

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
_ROFF = {"\\": "\\e", "-": "\\-", "~": "\\(ti", "^": "\\(ha", "'": "\\(aq", "`": "\\(ga"}
"""Signs that roff would print otherwise (groff_char(7))."""
_EVERYWHERE = ("--help", "--version", "--debug")  # described once, not for every subcommand


def add_manual(parser: Parser, whole: Callable[[], Parser] | None = None) -> None:
    """Add --print-man and --print-completion to a command's parser."""
    add = partial(parser.add_argument, action=_Print, const=whole)
    add("--print-man", nargs=0, help="print the man page and exit")
    text = "print a script that completes this command, and exit"
    add("--print-completion", choices=SHELLS, help=text)


def man_page(parser: argparse.ArgumentParser) -> str:
    """Return the page of a command and all its subcommands, for man(1)."""
    return "\n".join(_page(parser)) + "\n"


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
        """Print; `const` makes the parser with all subcommands, if this one is not whole."""
        whole = self.const() if self.const else parser
        text = completion(whole, given[1]) if self.nargs is None else man_page(whole)
        print(text, end="")  # noqa: T201 - what was asked for
        parser.exit()


def _page(parser: argparse.ArgumentParser) -> Iterator[str]:
    about = (parser.description or "").rstrip(".")
    yield f'.TH {parser.prog.upper()} 1 "" "{DISTRIBUTION} {installed_version()}"'
    yield from (".SH NAME", f"{parser.prog} \\- {_plain(about)}")
    yield ".SH SYNOPSIS"
    yield from _synopsis(parser)
    yield ".SH OPTIONS"
    yield from _options(parser)
    if subs := subparsers(parser):
        yield ".SH COMMANDS"
        for sub in subs.values():
            yield from _command(sub)
    if parser.epilog:
        yield ".SH EXAMPLES AND NOTES"
        yield from _verbatim(parser.epilog)
    yield ".SH EXIT STATUS"
    for code, words in EXIT_CODES.items():
        yield from (".TP", f".B {code}", _plain(words))


def _command(parser: argparse.ArgumentParser) -> Iterator[str]:
    yield f".SS {_plain(parser.prog)}"
    yield _plain(parser.description or "")
    yield ".PP"
    yield from _synopsis(parser)
    yield from _options(parser, without=_EVERYWHERE)
    for sub in subparsers(parser).values():
        yield from _command(sub)
    if parser.epilog:
        yield from _verbatim(parser.epilog)


def _synopsis(parser: argparse.ArgumentParser) -> Iterator[str]:
    usage = " ".join(parser.format_usage().removeprefix("usage: ").split())
    rest = usage.removeprefix(parser.prog).strip()
    yield f".B {_plain(parser.prog)}"
    if rest:
        yield _plain(rest)
    yield ".PP"


def _options(parser: argparse.ArgumentParser, without: tuple[str, ...] = ()) -> Iterator[str]:
    formatter = argparse.HelpFormatter(parser.prog)
    for action in parser._actions:
        if action.help == argparse.SUPPRESS or isinstance(action, argparse._SubParsersAction):
            continue
        if set(action.option_strings) & set(without):
            continue
        # The form of --help: `-o OUTPUT, --output OUTPUT`, or a positional's name.
        form = formatter._format_action_invocation(action)
        words = formatter._expand_help(action) if action.help else ""
        yield from (".TP", f".B {_plain(form)}", _plain(words))


def _verbatim(text: str) -> Iterator[str]:
    yield from (".PP", ".nf", ".RS")
    yield from (_plain(line, keep_spaces=True) for line in text.strip("\n").splitlines())
    yield from (".RE", ".fi")


def _plain(text: str, *, keep_spaces: bool = False) -> str:
    """Return text that roff prints as it is."""
    text = text if keep_spaces else " ".join(text.split())
    return re.sub(r"^\.", r"\\&.", "".join(_ROFF.get(sign, sign) for sign in text))
