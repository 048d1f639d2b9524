"""`radard detect`: many recordings judged as the daemon would, into one table."""

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from radard.commands.detect_tables import COLUMNS, FORMATS, Add, open_table
from radard.config.options import JUDGING, add_options, judging_config
from radard.errors import OutputError, RadardError, UsageError
from radard.run.components import make_classifier
from radard.run.replays import Judged, judge_all
from x2radar.atomic import whole_file
from x2radar.command import Parser, StatusLine, bar, legible, new_parser
from x2radar.recording.registry import check_no_recording

_EXAMPLES = """\
examples:
  radard detect night.h5                        decisions as CSV, on stdout
  radard detect *.h5 --out decisions.parquet    all cores; the suffix says the format
  radard detect /data/* --rows events --out alarms.csv
  radard detect a.h5 b.h5 --to jsonl --model mine.onnx | jq .label
"""
_MAX_JOBS = 1024  # beyond the cores of any machine that this runs on


def run(argv: Sequence[str]) -> int:
    parser = make_parser()
    args = parser.parse_args(argv)
    if args.jobs is not None and not 1 <= args.jobs <= _MAX_JOBS:
        parser.error(f"--jobs {args.jobs}: must be 1 to {_MAX_JOBS}")
    kind = _format(args.to, args.out)
    config = judging_config(args, "recordings")
    # Else every recording would say that it cannot be had.
    make_classifier(config)
    line = StatusLine(sys.stderr)
    paths: list[Path] = args.files
    jobs = args.jobs or min(len(paths), os.cpu_count() or 1)
    faulty: list[Judged] = []

    def tell(share: float, n: int) -> None:
        line.show(f"[{bar(share)}] {n} of {len(paths)} recordings")

    n_rows = 0
    with _table(kind, args.rows, args.out) as add:
        for judged in judge_all(paths, config, jobs=jobs, tell=tell):
            note = judged.fault
            if note:
                faulty.append(judged)
            elif (n := add(judged)) or args.rows != "decisions":
                n_rows += n
            else:
                note = f"{legible(judged.path)}: no decision: it is shorter than a window"
            if note and (len(paths) > 1 or not judged.fault):
                line.clear()
                print(f"radard: {note}", file=sys.stderr)
        line.clear()
        if len(faulty) == len(paths):
            # Before a table without rows takes the place of an older one.
            raise _error(faulty, len(paths))
    if args.out is not None:
        what, n_well = "records" if kind == "jsonl" else args.rows, len(paths) - len(faulty)
        of = "1 recording" if n_well == 1 else f"{n_well} recordings"
        print(f"{args.out}: {n_rows} {what} of {of}", file=sys.stderr)
    if faulty:
        raise _error(faulty, len(paths))
    return 0


def make_parser() -> Parser:
    parser = new_parser(
        "radard detect",
        "Judge recordings as radard --port replay:FILE does, and write a table.",
        _EXAMPLES,
    )
    add = parser.add_argument
    add("files", nargs="+", type=Path, metavar="FILE", help="recording, or folder of its parts")
    add("--to", choices=FORMATS, help="format (by the suffix of --out, else csv)")
    add("--out", type=Path, metavar="FILE", help="file to write (stdout)")
    add("--rows", choices=list(COLUMNS), default="decisions", help="of the table (decisions)")
    add("--jobs", type=int, metavar="N", help="processes (all cores)")
    add_options(parser, *JUDGING)
    return parser


def _format(to: str | None, out: Path | None) -> str:
    by_name = out.suffix.removeprefix(".").lower() if out is not None else ""
    kind = to or by_name or "csv"
    if kind not in FORMATS:
        msg = f"--out {out}: no format is called {by_name}; --to is {', '.join(FORMATS)}"
        raise UsageError(msg)
    if kind == "parquet" and out is None:
        raise UsageError("--to parquet: a table like that needs --out FILE")
    return kind


@contextlib.contextmanager
def _table(kind: str, rows: str, out: Path | None) -> Iterator[Add]:
    """Lend a table; what it replaces stays until all of it is written."""
    if out is None:
        with open_table(kind, rows, sys.stdout, None) as add:
            yield add
        return
    check_no_recording(out)
    try:
        with contextlib.ExitStack() as opened:
            part = opened.enter_context(whole_file(out))
            is_text = kind != "parquet"
            file = opened.enter_context(part.open("w", encoding="utf-8")) if is_text else None
            yield opened.enter_context(open_table(kind, rows, file, part))
    except OSError as err:
        raise OutputError(f"--out {out}: cannot write: {err.strerror or err}") from err


def _error(faulty: Sequence[Judged], n: int) -> RadardError:
    first = faulty[0]
    said = first.fault if n == 1 else f"{len(faulty)} of {n} recordings could not be judged"
    error = RadardError(said)
    error.exit_code = first.exit_code
    return error
