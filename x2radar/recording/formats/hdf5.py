"""HDF5 recordings as a format to convert to; `x2radar.recording.hdf5_reader` reads them."""

from pathlib import Path

from x2radar.recording.blocks import BlockReader
from x2radar.recording.hdf5_writer import RecordingWriter, write_labels


def write(path: Path, source: BlockReader) -> list[str]:
    """Write `source` into a new file, bit by bit; return what was not kept."""
    with RecordingWriter(
        path,
        source.stream,
        started_utc=source.started_utc,
        device=source.device,
        settings=source.settings,
    ) as writer:
        for block in source.blocks():
            writer.write_block(block)
    write_labels(path, source.labels)
    return ["decisions are not copied"] if getattr(source, "has_decisions", False) else []
