"""`radard detect`: many recordings judged as the daemon would, into one table.

`time` is by the recording's own start, empty where that is not known; nothing of the replay's own
clock is in it, so the same recordings give the same table, byte for byte.
"""

import contextlib
import csv
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from radard.config.options import JUDGING, add_options, check_limits, judging_config
from radard.config.quiet_hours import recorded_clock
from radard.errors import OutputError, RadardError, UsageError
from radard.judge.bundle import PROBABILITIES
from radard.outputs.records import Record
from radard.run.components import make_classifier
from radard.run.replays import Judged, judge_all
from x2radar.atomic import whole_file
from x2radar.command import Parser, StatusLine, bar, legible, new_parser
from x2radar.extras import needed
from x2radar.recording.registry import check_no_recording
from x2radar.wall_clock import utc_text

_ABOUT = "Judge recordings as radard --port replay:FILE does, and write a table."
_EXAMPLES = """\
examples:
  radard detect night.h5                        decisions as CSV, on stdout
  radard detect *.h5 --out decisions.parquet    all cores; the suffix says the format
  radard detect /data/* --rows events --out alarms.csv
  radard detect a.h5 b.h5 --to jsonl --model mine.onnx | jq .label
"""
FORMATS = ("csv", "parquet", "jsonl")
COLUMNS = {
    "decisions": (
        *("file", "seq", "t_s", "time", "gate", "power_db", "noise_floor_db", "threshold_db"),
        *(*PROBABILITIES, "label", "alarm", "range_m", "n_tracks", "frames", "dropped"),
    ),
    "events": (
        *("file", "id", "phase", "kind", "t_s", "time", "start_t_s", "end_t_s", "peak", "reason"),
    ),
}  # of a table by its rows
_TYPES = {
    **dict.fromkeys(("file", "time", "gate", "label", "id", "phase", "kind", "reason"), "string"),
    **dict.fromkeys(("seq", "n_tracks", "frames", "dropped"), "int64"),
    "alarm": "bool_",
}  # of a column, as pyarrow names them; of all others float64
_BATCH = 4096  # rows of a Parquet row group: about a megabyte


def run(argv: Sequence[str]) -> int:
    args = make_parser().parse_args(argv)
    check_limits(args, jobs=(1, 1024))  # beyond the cores of any machine that this runs on
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
    parser = new_parser("radard detect", _ABOUT, _EXAMPLES)
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
        raise UsageError(f"--out {out}: no format called {by_name}; --to is {', '.join(FORMATS)}")
    if kind == "parquet" and out is None:
        raise UsageError("--to parquet: a table like that needs --out FILE")
    return kind


@contextlib.contextmanager
def _table(kind: str, rows: str, out: Path | None) -> Iterator[Callable[[Judged], int]]:
    """Lend what writes the rows of a recording and counts them; or MissingExtra, OutputError.

    What `out` replaces stays until all of it is written.
    """
    if out is not None:
        check_no_recording(out)
    try:
        with contextlib.ExitStack() as opened:
            part = None if out is None else opened.enter_context(whole_file(out))
            write = _writer(kind, rows, part, opened)

            def add(judged: Judged) -> int:
                n, made = 0, _records(judged, "" if kind == "jsonl" else rows)
                while batch := list(islice(made, _BATCH)):
                    write(batch)
                    n += len(batch)
                return n

            yield add
            sys.stdout.flush()
    except OSError as err:
        if out is None:
            raise
        raise OutputError(f"--out {out}: cannot write: {err.strerror or err}") from err


def _writer(
    kind: str, rows: str, part: Path | None, opened: contextlib.ExitStack
) -> Callable[[list[Record]], object]:
    """Return what writes records into a file, or on stdout where `part` is None."""
    if kind == "parquet":
        pa: Any = needed("pyarrow", what="Parquet files")
        parquet: Any = needed("pyarrow.parquet", what="Parquet files")
        types = {name: getattr(pa, _TYPES.get(name, "float64"))() for name in COLUMNS[rows]}
        schema = pa.schema(types.items())
        assert part is not None  # noqa: S101 - a table of its own
        # Opened here: pyarrow takes no name that is not UTF-8.
        whole = opened.enter_context(part.open("wb"))
        to = opened.enter_context(parquet.ParquetWriter(whole, schema, compression="zstd"))
        return lambda batch: to.write_table(pa.Table.from_pylist(batch, schema=schema))
    file = sys.stdout
    if part is not None:
        file = opened.enter_context(part.open("w", encoding="utf-8"))
    if kind == "jsonl":
        encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode
        return lambda batch: file.writelines(f"{encode(record)}\n" for record in batch)
    lines = csv.DictWriter(file, COLUMNS[rows], lineterminator="\n")
    lines.writeheader()
    if rows == "events":
        return lines.writerows
    return lambda batch: lines.writerows(
        {**row, "alarm": str(row["alarm"]).lower()} for row in batch
    )


def _records(judged: Judged, rows: str) -> Iterator[Record]:
    """Yield what is told of a recording: the columns of `rows`, or all there is without."""
    clock = recorded_clock(judged.started_utc)
    for record in judged.read():
        told = {"file": legible(judged.path), **record}
        told.pop("time", None)
        told.pop("latency_ms", None)
        if "t_s" in record:
            at = clock(record["t_s"])
            told["time"] = utc_text(at) if at else None
        if not rows:
            yield told
        elif record["type"] == rows.removesuffix("s"):
            told["n_tracks"] = len(record.get("tracks", ()))
            yield {name: told[name] for name in COLUMNS[rows]}


def _error(faulty: Sequence[Judged], n: int) -> RadardError:
    first = faulty[0]
    said = first.fault if n == 1 else f"{len(faulty)} of {n} recordings could not be judged"
    error = RadardError(said)
    error.exit_code = first.exit_code
    return error
