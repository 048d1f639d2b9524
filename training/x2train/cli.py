"""The command `train-export`: simulate, train, export."""

import sys
from collections.abc import Sequence

from x2radar.command import new_parser, run_command
from x2train.commands import scene, train

_EXAMPLES = """\
examples:
  train-export train                          the bundle that ./run uses, into models/
  train-export scene human --plot human.png   a scene as the radar sees it
"""
_COMMANDS = (scene, train)


def main(argv: Sequence[str] | None = None) -> int:
    """Run `train-export`; return its exit code."""
    return run_command("train-export", _body, argv)


def _body(argv: Sequence[str]) -> int:
    parser = new_parser("train-export", "Simulate, train and export classifiers.", _EXAMPLES)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for command in _COMMANDS:
        command.register(commands)
    args = parser.parse_args(argv)
    code: int = args.run(args)
    return code


if __name__ == "__main__":
    sys.exit(main())
