"""Open a recording of any known format by what it is."""

from pathlib import Path

from x2radar.recording import RecordingReader
from x2radar.xethru import XethruReader

Reader = RecordingReader | XethruReader


def open_recording(path: str | Path) -> Reader:
    """Return a reader for an HDF5 recording, a XeThru folder or a XeThru ``.dat`` file.

    Raises
    ------
    RecordingError
        If nothing readable is there.
    """
    path = Path(path)
    if path.is_dir() or path.suffix == ".dat":
        return XethruReader(path)
    return RecordingReader(path)
