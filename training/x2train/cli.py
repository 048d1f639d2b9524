"""The command `train-export`: simulate, train, export."""

import pkgutil
from collections.abc import Sequence
from importlib import import_module

from x2radar.command import Parser, new_parser, run_command
from x2radar.manual import add_manual
from x2train import commands

_EXAMPLES = """\
examples:
  train-export dataset --out sets/train       windows of simulated passages
  train-export fit --train sets/train --validate sets/validate
  train-export temporal --model models/mine.onnx --train sets/long --validate sets/check
  train-export make balanced --show           how a shipped bundle is made, or do it
  train-export finetune rex.h5=pet --guard sets/guard --mix sets/mix
  train-export evaluate --out report          a bundle, judged like an alarm
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run `train-export`; return its exit code."""
    return run_command("train-export", _body, argv)


def _body(argv: Sequence[str]) -> int:
    args = whole_parser().parse_args(argv)
    code: int = args.run(args)
    return code


def whole_parser() -> Parser:
    """Return the parser with every subcommand in it."""
    parser = new_parser("train-export", "Simulate, train and export classifiers.", _EXAMPLES)
    add_manual(parser)
    parser.set_defaults(train_export=_body)
    known = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for found in pkgutil.iter_modules(commands.__path__):
        import_module(f"{commands.__name__}.{found.name}").register(known)
    import_module("x2train.thesis.command").register(known)
    return parser
