"""`docs/tradeoff.md`, all its tables and pictures: runs `profiles.py`, then `tradeoff.py`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import profiles
import tradeoff
from study import one_thread, script_parser

_DOCS = Path(__file__).parents[1] / "docs"
_RATIO = 4  # passages of the switches' table for each of the profiles'


def main(argv: Sequence[str] | None = None) -> int:
    """Measure everything, replace what the page has."""
    parser = script_parser(
        "trade_page",
        "Make the tables and pictures of docs/tradeoff.md.",
        "--recorded walks/\n--passages 3 --rounds 1 --docs build/docs",
    )
    add = parser.add_argument
    add("--passages", type=int, default=100, help="people, and as many visits of pets (100)")
    add("--rounds", type=int, default=9, help="how often CPU time is measured (9)")
    add("--recorded", nargs="+", default=[], metavar="DIR", help="as of profiles.py")
    add("--docs", type=Path, default=_DOCS, metavar="DIR", help="where tradeoff.md is")
    add("--file", type=Path, default=profiles.FILE, metavar="FILE", help="as of profiles.py")
    return _run(parser.parse_args(argv))


def _run(args: argparse.Namespace) -> int:
    page, images = str(args.docs / "tradeoff.md"), args.docs / "images"
    common = ["--rounds", str(args.rounds), "--page", page]
    own = ["--passages", str(args.passages), "--file", str(args.file)]
    own += ["--plot", str(images / "profiles.png"), "--levers-plot", str(images / "levers.png")]
    recorded = ["--recorded", *args.recorded] if args.recorded else []
    models = ["--combine", "fast", "balanced", "accurate"]
    passages = ["--passages", str(_RATIO * args.passages)]
    return profiles.main([*common, *own, *recorded]) or tradeoff.main(
        [*common, *models, *passages, "--plot", str(images / "tradeoff.png")]
    )


if __name__ == "__main__":
    one_thread()
    sys.exit(main())
