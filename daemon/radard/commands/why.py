"""`radard why`: one moment of a recording, explained."""

import sys
from collections.abc import Sequence
from pathlib import Path

from radard.config.config import load_config
from radard.config.options import add_judging, config_options
from radard.errors import OutputError, UsageError
from x2radar.command import Parser, new_parser
from x2radar.extras import needed

_EXAMPLES = """\
examples:
  radard why night.h5 --at 3605.5                    in words
  radard why night.h5 --at 3605.5 --out why.png      and as a picture
The picture needs the extra plot. Red parts of a map spoke for a person.
"""
_SUFFIXES = (".png", ".pdf", ".svg")


def run(argv: Sequence[str]) -> int:
    """Run the subcommand."""
    args = make_parser().parse_args(argv)
    out: Path | None = args.out
    if out is not None:
        if out.suffix not in _SUFFIXES:
            msg = f"--out {out}: must end in {', '.join(_SUFFIXES)}"
            raise UsageError(msg)
        needed("matplotlib", what="pictures")
    if not 0 <= args.at < 1e9:
        msg = f"--at {args.at:g}: must be 0 or more, in seconds"
        raise UsageError(msg)
    config = load_config(args.config, options=config_options(args)).of_sensor(args.sensor)
    # Late: --help must not wait for the model's runtime.
    from radard.offline.moment import moment_of  # noqa: PLC0415
    from radard.offline.occlusion import occluded  # noqa: PLC0415
    from radard.offline.why_report import figure, lines  # noqa: PLC0415

    moment = moment_of(args.file, args.at, config)
    parts = []
    if moment.classifier is not None and moment.seen is not None:
        parts = occluded(moment.classifier, moment.settings, moment.seen, moment.pet_limit)
    print("\n".join(lines(moment, parts)))
    if out is not None:
        try:
            figure(moment, parts).savefig(out, dpi=110)
        except OSError as err:
            msg = f"--out {out}: cannot write: {err.strerror or err}"
            raise OutputError(msg) from err
        print(out, file=sys.stderr)
    return 0


def make_parser() -> Parser:
    """Return the parser of the subcommand."""
    parser = new_parser(
        "radard why",
        "Say why a recording was judged as it was at one moment, and what moved the verdict.",
        _EXAMPLES,
    )
    add = parser.add_argument
    add("file", type=Path, metavar="FILE", help="recording, or folder of its parts")
    add("--at", type=float, required=True, metavar="S", help="seconds of the recording")
    add("--out", type=Path, metavar="FILE", help="PNG, PDF or SVG to draw")
    add_judging(parser)
    return parser
