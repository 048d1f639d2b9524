"""Parquet tables for pandas, polars, DuckDB and Spark; written only.

A row is a frame: counter uint32, t_s float64, and its samples as a list of n_range float32,
`samples` of RF frames, `samples_i` and `samples_q` of baseband. The attributes of an HDF5
recording, with device, settings and labels, are JSON in the schema's metadata under `x2radar`.
"""

import json
from pathlib import Path
from typing import Any

from x2radar.extras import needed
from x2radar.recording.blocks import BlockReader
from x2radar.recording.formats.columns import column_names, described, real_columns


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new file, block by block; return what was not kept: nothing.

    Raises MissingExtra without pyarrow.
    """
    pa: Any = needed("pyarrow", what="Parquet files")
    parquet: Any = needed("pyarrow.parquet", what="Parquet files")
    axis = source.stream.axis
    row = pa.list_(pa.float32(), axis.n_range)
    schema = pa.schema(
        [
            ("counter", pa.uint32()),
            ("t_s", pa.float64()),
            *((name, row) for name in column_names(axis.kind)),
        ],
        metadata={"x2radar": json.dumps(described(source), default=str)},
    )
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for block in source.blocks():
            lists = [
                pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), axis.n_range)
                for values in real_columns(block.samples).values()
            ]
            columns = [pa.array(block.counter), pa.array(block.t_s), *lists]
            writer.write_table(pa.Table.from_arrays(columns, schema=schema))
    return []
