"""The command `x2radar`: joins the subcommands of `x2radar.commands`."""

from collections.abc import Sequence

from x2radar.command import Parser, new_parser, run_command
from x2radar.commands import convert, decode, info, plot, record, selftest, simulate
from x2radar.manual import add_manual

_EXAMPLES = """\
examples:
  x2radar ports --probe                       which port has a module
  x2radar selftest --port /dev/ttyACM0        is it in order?
  x2radar scenes                              what can be simulated
  x2radar simulate --scene human --pty        a module to open like a real one
  x2radar record --port sim:dog --duration 10 dog.h5
  x2radar info dog.h5                         what is in a file, or behind a port
  x2radar plot dog.h5 --out dog.png           range, velocity and spectrum
  x2radar convert dog.h5 dog.npz              between recording formats
  x2radar decode trace.txt                    a byte trace as JSON Lines
"""
_COMMANDS = (info, selftest, simulate, plot, record, convert, decode)


def main(argv: Sequence[str] | None = None) -> int:
    """Run `x2radar`; return its exit code."""

    def body(words: Sequence[str]) -> int:
        args = whole_parser().parse_args(words)
        return int(args.run(args))

    return run_command("x2radar", body, argv)


def whole_parser() -> Parser:
    """Return the parser with every subcommand in it."""
    parser = new_parser("x2radar", "Tool for XeThru X2 radar modules.", _EXAMPLES)
    add_manual(parser)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in _COMMANDS:
        module.register(commands)
    return parser
