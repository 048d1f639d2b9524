"""The command `train-export`: simulate, train, export."""

import pkgutil
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType

from x2radar.command import Parser, import_fault, new_parser, run_command
from x2radar.errors import renamed
from x2radar.manual import add_manual, subparsers

try:
    from x2train import commands
except ModuleNotFoundError as err:
    raise import_fault(err, prog="train-export") from err

_EXAMPLES = """\
examples:
  train-export dataset --out sets/train       windows of simulated passages
  train-export fit --train sets/train --validate sets/validate
  train-export temporal --model models/mine.onnx --train sets/long --validate sets/check
  train-export make balanced --show           how a shipped bundle is made, or do it
  train-export finetune rex.h5=pet --guard sets/guard --mix sets/mix
  train-export evaluate --out report          a bundle, judged like an alarm
"""
_STUDIES = "research"
_GONE = {
    "seed": f"{renamed('seed')}see train-export thesis --help",
    "train": "'train' is gone: train-export thesis --bundle writes the bundle of such a network",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run `train-export`; return its exit code."""
    return run_command("train-export", _body, argv)


def _body(argv: Sequence[str]) -> int:
    parser = whole_parser()
    name = argv[0] if argv else ""
    if name in _GONE:
        parser.error(_GONE[name])
    is_known = name.startswith("-") or name in subparsers(parser)
    if name and not is_known and not _has_studies():
        parser.error(
            f"'{name}' is no command of an installed train-export; the studies behind the pages "
            "of docs run from a checkout of the source"
        )
    args = parser.parse_args(argv)
    code: int = args.run(args)
    return code


def whole_parser() -> Parser:
    """Return the parser with every subcommand in it."""
    parser = new_parser("train-export", "Simulate, train and export classifiers.", _EXAMPLES)
    add_manual(parser)
    parser.set_defaults(train_export=_body)
    known = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in _modules():
        module.register(known)
    return parser


def _modules() -> Iterator[ModuleType]:
    """Yield what registers a command: each file of commands, and each study where it is."""
    for found in pkgutil.iter_modules(commands.__path__):
        yield import_module(f"{commands.__name__}.{found.name}")
    yield import_module("x2train.thesis.command")
    if _has_studies():
        for found in pkgutil.iter_modules(import_module(_STUDIES).__path__):
            yield import_module(f"{_STUDIES}.{found.name}.command")


def _has_studies() -> bool:
    """Return whether this is a checkout: the wheel has no studies."""
    return find_spec(_STUDIES) is not None


if __name__ == "__main__":
    sys.exit(main())
