"""Records to rows: CSV, Parquet or JSON Lines of many recordings in one table.

`time` is by the recording's own start, empty where that is not known; nothing of the replay's own
clock is in it, so the same recordings give the same table, byte for byte.
"""

import csv
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

from radard.judge.bundle import PROBABILITIES
from radard.outputs.records import Record
from radard.run.replays import Judged
from x2radar.command import legible
from x2radar.extras import needed
from x2radar.wall_clock import parse_utc, utc_text

FORMATS = ("csv", "parquet", "jsonl")
DECISIONS: Mapping[str, str] = {
    "file": "string",
    "seq": "int64",
    "t_s": "float64",
    "time": "string",
    "gate": "string",
    **dict.fromkeys(("power_db", "noise_floor_db", "threshold_db", *PROBABILITIES), "float64"),
    "label": "string",
    "alarm": "bool_",
    "range_m": "float64",
    "n_tracks": "int64",
    "frames": "int64",
    "dropped": "int64",
}
EVENTS: Mapping[str, str] = {
    "file": "string",
    "id": "string",
    "phase": "string",
    "kind": "string",
    "t_s": "float64",
    "time": "string",
    "start_t_s": "float64",
    "end_t_s": "float64",
    "peak": "float64",
    "reason": "string",
}
COLUMNS = {"decisions": DECISIONS, "events": EVENTS}  # types as pyarrow names them
_BATCH = 4096  # rows of a Parquet row group: about a megabyte

Row = dict[str, Any]
Add = Callable[[Judged], int]  # writes the rows of what was judged; returns how many


@contextmanager
def open_table(kind: str, rows: str, file: TextIO | None, path: Path | None) -> Iterator[Add]:
    """Lend a table of `FORMATS` in a text `file`, or a Parquet `path`; or MissingExtra."""
    if kind == "parquet":
        pa: Any = needed("pyarrow", what="Parquet files")
        parquet: Any = needed("pyarrow.parquet", what="Parquet files")
        types = COLUMNS[rows].items()
        schema = pa.schema([(name, getattr(pa, t)()) for name, t in types])
        assert path is not None  # noqa: S101 - a table of its own
        # Opened here: pyarrow takes no name that is not UTF-8.
        with (
            path.open("wb") as whole,
            parquet.ParquetWriter(whole, schema, compression="zstd") as writer,
        ):

            def add_groups(judged: Judged) -> int:
                n, made = 0, table_rows(judged, rows)
                while batch := list(islice(made, _BATCH)):
                    writer.write_table(pa.Table.from_pylist(batch, schema=schema))
                    n += len(batch)
                return n

            yield add_groups
        return
    assert file is not None  # noqa: S101 - text formats have one
    if kind == "csv":
        lines = csv.DictWriter(file, list(COLUMNS[rows]), lineterminator="\n")
        lines.writeheader()

        def add(judged: Judged) -> int:
            made = list(table_rows(judged, rows))
            if rows == "decisions":
                made = [{**row, "alarm": str(row["alarm"]).lower()} for row in made]
            lines.writerows(made)
            return len(made)
    else:

        def add(judged: Judged) -> int:
            n = 0
            for record in judged.read():
                told = {"file": legible(judged.path), **_timed(record, judged.started_utc)}
                file.write(json.dumps(told, separators=(",", ":"), allow_nan=False) + "\n")
                n += 1
            return n

    yield add
    file.flush()


def table_rows(judged: Judged, rows: str) -> Iterator[Row]:
    """Yield the rows of a recording, as mappings with the columns of `rows`."""
    wanted = rows.removesuffix("s")
    names = COLUMNS[rows]
    for record in judged.read():
        if record["type"] == wanted:
            told = {"file": legible(judged.path), **_timed(record, judged.started_utc)}
            told["n_tracks"] = len(record.get("tracks", ()))
            yield {name: told[name] for name in names}


def _timed(record: Record, started_utc: str) -> Row:
    kept = {k: v for k, v in record.items() if k not in {"time", "latency_ms"}}
    if "t_s" in record:
        kept["time"] = time_of(started_utc, record["t_s"])
    return kept


def time_of(started_utc: str, t_s: float) -> str | None:
    """Return a moment of a recording in ISO 8601; None if its start is not known.

    >>> time_of("2026-03-01T12:30:00.250Z", 61.5)
    '2026-03-01T12:31:01.750Z'
    >>> time_of("", 61.5)
    """
    started = parse_utc(started_utc)
    return utc_text(started + timedelta(seconds=t_s)) if started else None
