"""Recordings of any known format, opened by what they are; `FORMATS` has a row each.

Their modules are imported when one is opened, because h5py takes a while.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from x2radar.errors import SettingsError
from x2radar.recording.about import NO_OVERRIDES, Overrides
from x2radar.recording.blocks import BlockReader
from x2radar.recording.faults import refuse, unreadable


@dataclass(frozen=True, slots=True)
class Format:
    """One format, and what reads and writes it in `module`, below `formats`."""

    name: str  # as ``--from`` and ``--to`` take it
    title: str
    suffixes: tuple[str, ...]
    module: str
    reader: str = "Reader"  # makes a BlockReader of path and overrides; empty: written only
    writer: str = "write"  # ``write(path, source)``; empty when the format is only read
    magic: bytes = b""  # first bytes of such files; empty when they have none
    content: str = ""  # tells whether a file with that magic is one; empty: magic is enough
    in_folder: str = ""  # pattern of the files in a folder that is such a recording
    pair: str = ""  # gives the files of a recording from the name of any

    def open(self, path: Path, overrides: Overrides) -> BlockReader:
        """Return a reader of `path`; raises RecordingError if the format is only written."""
        if not self.reader:
            raise refuse(path, f"{self.title}s are only written; open what it was made of")
        made: BlockReader = self._named(self.reader)(path, overrides=overrides)
        return made

    def is_in(self, path: Path, head: bytes) -> bool:
        """Return whether a file that begins with `head` is one of these, by what is in it."""
        is_like = bool(self.magic) and head.startswith(self.magic)
        return is_like and (not self.content or bool(self._named(self.content)(path)))

    def write(self, path: Path, source: BlockReader) -> list[str]:
        """Write `source` into `path`, which is new; return what was not kept."""
        notes: list[str] = self._named(self.writer)(path, source)
        return notes

    def files(self, path: Path) -> tuple[Path, ...]:
        """Return the files that make the recording `path`, whether they are there or not."""
        return tuple(self._named(self.pair)(path)) if self.pair else (path,)

    def _named(self, name: str) -> Any:
        return getattr(import_module(f".{self.module}", "x2radar.recording.formats"), name)


FORMATS: Mapping[str, Format] = {
    row.name: row
    for row in (
        Format(
            "hdf5",
            "HDF5 recording",
            (".h5", ".hdf5"),
            ".parts",
            "open_hdf5",
            magic=b"\x89HDF\r\n\x1a\n",
            in_folder="[!.]*.h5",
        ),
        Format("xethru", "XeThru recording", (".dat",), "xethru", in_folder="xethru_*.dat"),
        Format(
            "framelogger",
            "FrameLogger file",
            (".framelogger",),
            "framelogger",
            magic=b"\xa2\x00\xfe\xfe",
        ),
        # Before p4xx: its first bytes are those of every MATLAB file.
        Format(
            "mat", "MATLAB file", (".mat",), "matlab", magic=b"MATLAB 5.0", content="has_frames"
        ),
        Format("p4xx", "P4xx MATLAB file", (".mat",), "matlab", "P4xxReader", "", b"MATLAB "),
        Format(
            "sigmf",
            "SigMF pair",
            (".sigmf-meta", ".sigmf-data", ".sigmf"),
            "sigmf",
            pair="pair_of",
        ),
        Format("npz", "NumPy archive", (".npz",), "npz", magic=b"PK\x03\x04"),
        Format("parquet", "Parquet table", (".parquet",), "columns", "", "write_parquet", b"PAR1"),
        Format("mcap", "MCAP file", (".mcap",), "columns", "", "write_mcap", b"\x89MCAP0\r\n"),
        Format("capture", "wire capture", (".x2cap",), ".capture", writer="", magic=b"X2RADARC"),
    )
}
WRITABLE = tuple(row.name for row in FORMATS.values() if row.writer)
READABLE = tuple(row.name for row in FORMATS.values() if row.reader)

_MAX_MAGIC = max(len(row.magic) for row in FORMATS.values())


def check_name(path: Path, kind: str) -> None:
    """Raise SettingsError if a file of this name would be taken for something else."""
    row = FORMATS[kind]
    if path.suffix and format_by_name(path) is not row:
        msg = f"{path}: the name of a recording like this ends in {' or '.join(row.suffixes)}"
        raise SettingsError(msg)


def check_no_recording(path: Path) -> None:
    """Raise RecordingError if a recording is there, which nothing else may replace."""
    if path.is_file() and any(row.reader for row in _candidates(path)):
        raise refuse(path, "is a recording, which is not overwritten")


def format_by_name(path: Path) -> Format | None:
    """Return the format that a file's name promises, or None."""
    return next((row for row in FORMATS.values() if path.name.endswith(row.suffixes)), None)


def format_of(path: Path) -> Format:
    """Return the format of what is there, by content, then name; or RecordingError."""
    if found := next(_candidates(path), None):
        return found
    if not path.exists():
        raise refuse(path, "no such recording")
    known = ", ".join(row.title for row in FORMATS.values() if row.reader)
    raise refuse(path, f"no recording of a known format ({known})")


def _candidates(path: Path) -> Iterator[Format]:
    rows = FORMATS.values()
    if path.is_dir():
        # The last first: HDF5 files may lie beside a XeThru recording, not the other way round.
        fits = [row for row in rows if row.in_folder and any(path.glob(row.in_folder))]
        yield from reversed(fits)
        return
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(_MAX_MAGIC)
        yield from (row for row in rows if row.is_in(path, head))
    if by_name := format_by_name(path):
        yield by_name
    yield from (row for row in rows if row.pair and row.files(path)[0].is_file())


def open_recording(
    path: str | Path | Sequence[str | Path],
    *,
    kind: str | None = None,
    overrides: Overrides = NO_OVERRIDES,
) -> BlockReader:
    """Open a recording of any format in `FORMATS`; return a reader of its frames, to be closed.

    Parameters
    ----------
    path : str, Path or a sequence of them
        A file, a XeThru folder, or the folder, the name or the list of an HDF5 recording's parts.
    kind : str, optional
        Name of the format (``hdf5``, ``npz`` ...), instead of looking.
    overrides : Overrides
        Rate and axis, where the recording is silent or wrong.

    Raises
    ------
    X2RadarError
        RecordingError if nothing readable is there; one line that says what.

    Examples
    --------
    Nothing in a file is trusted or executed; a NumPy archive of noise will do:

    >>> import numpy as np
    >>> rows = np.random.default_rng(1).standard_normal((180, 64)).astype(np.float32)
    >>> np.savez("noise.npz", samples=rows)
    >>> about = Overrides(frame_rate_hz=60, bin_length_m=0.05, carrier_hz=6.8e9)
    >>> with open_recording("noise.npz", overrides=about) as recording:
    ...     frames = list(recording.frames(start_s=1.0))
    >>> recording.n_frames, len(frames), frames[0].index
    (180, 120, 60)
    """
    if kind is not None and kind not in READABLE:
        raise SettingsError(f"'{kind}' is no format that is read; known are {', '.join(READABLE)}")
    with unreadable(path):
        if not isinstance(path, str | Path):
            from x2radar.recording.parts import PartsReader  # noqa: PLC0415 - h5py takes a while

            return PartsReader([Path(part) for part in path], overrides)
        path = Path(path)
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise refuse(path, "is no file: a recording is read more than once")
        return (FORMATS[kind] if kind else format_of(path)).open(path, overrides)
