"""The command `train-export`: simulate, train, export."""

import sys
from collections.abc import Sequence

from x2radar.command import new_parser, run_command
from x2radar.errors import renamed
from x2train.commands import (
    dataset,
    evaluate,
    finetune,
    fit,
    make,
    scene,
    temporal,
    thesis,
    tradeoff,
    train,
    walks,
)

_EXAMPLES = """\
examples:
  train-export dataset --out sets/train       windows of simulated passages
  train-export fit --train sets/train --validate sets/validate
  train-export temporal --model models/mine.onnx --train sets/long --validate sets/check
  train-export make balanced --show           how a shipped bundle is made, or do it
  train-export finetune rex.h5=pet --guard sets/guard
  train-export evaluate --out report          a bundle, judged like an alarm
  train-export thesis --animal dog --repeats 3  the thesis, reproduced
  train-export scene human --plot human.png   a scene as the radar sees it
  train-export tradeoff                       what each switch costs and loses
  train-export walks 101.mat 102.mat --out .  simulated walkers beside recorded ones
"""
_COMMANDS = (
    dataset,
    evaluate,
    finetune,
    fit,
    scene,
    thesis,
    temporal,
    tradeoff,
    train,
    walks,
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run `train-export`; return its exit code."""
    return run_command("train-export", _body, argv)


def _body(argv: Sequence[str]) -> int:
    parser = new_parser("train-export", "Simulate, train and export classifiers.", _EXAMPLES)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in _COMMANDS:
        command.register(commands)
    make.register(commands, _body)
    if argv and argv[0] == "seed":
        parser.error(f"{renamed('seed')}see train-export thesis --help")
    args = parser.parse_args(argv)
    code: int = args.run(args)
    return code


if __name__ == "__main__":
    sys.exit(main())
