"""Open a recording of any known format by what it is.

`KINDS` is the table of formats. Their modules are imported when one is opened, because h5py
and scipy take a while.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from x2radar.errors import RecordingError
from x2radar.recording.blocks import NO_OVERRIDES, BlockReader, Overrides, refuse

Reader = BlockReader


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One format.

    Attributes
    ----------
    name : str
        As ``--from`` and ``--to`` take it.
    title : str
        For people.
    reader : str
        ``module:class``, called with path and overrides.
    writer : str
        ``module`` with a function ``write(path, source)``; empty when it is only read.
    suffixes : tuple of str
        Ends of file names.
    magic : bytes
        First bytes of such files; empty when they have none.
    """

    name: str
    title: str
    reader: str
    writer: str
    suffixes: tuple[str, ...]
    magic: bytes = b""

    def open(self, path: Path, overrides: Overrides) -> BlockReader:
        """Return a reader of `path`."""
        module, _, name = self.reader.partition(":")
        made: BlockReader = getattr(import_module(module), name)(path, overrides=overrides)
        return made

    def write(self, path: Path, source: BlockReader) -> list[str]:
        """Write `source` into `path`, which is new; return what was not kept."""
        write: Callable[[Path, Any], list[str]] = import_module(self.writer).write
        return write(path, source)


_FORMATS = "x2radar.recording.formats."
_KINDS = (
    Kind(
        name="hdf5",
        title="HDF5 recording",
        reader="x2radar.recording.hdf5_reader:RecordingReader",
        writer=_FORMATS + "hdf5",
        suffixes=(".h5", ".hdf5"),
        magic=b"\x89HDF\r\n\x1a\n",
    ),
    Kind(
        name="xethru",
        title="XeThru recording",
        reader="x2radar.recording.xethru:XethruReader",
        writer=_FORMATS + "xethru_writer",
        suffixes=(".dat",),
    ),
    Kind(
        name="framelogger",
        title="FrameLogger file",
        reader=_FORMATS + "framelogger:FrameLoggerReader",
        writer=_FORMATS + "framelogger",
        suffixes=(".framelogger",),
        magic=b"\xa2\x00\xfe\xfe",
    ),
    Kind(
        name="p4xx",
        title="P4xx MATLAB file",
        reader=_FORMATS + "p4xx:P4xxReader",
        writer="",
        suffixes=(".mat",),
        magic=b"MATLAB ",
    ),
    Kind(
        name="sigmf",
        title="SigMF pair",
        reader=_FORMATS + "sigmf:SigmfReader",
        writer=_FORMATS + "sigmf",
        suffixes=(".sigmf-meta", ".sigmf-data", ".sigmf"),
    ),
    Kind(
        name="npz",
        title="NumPy archive",
        reader=_FORMATS + "npz:NpzReader",
        writer=_FORMATS + "npz",
        suffixes=(".npz",),
        magic=b"PK\x03\x04",
    ),
    Kind(
        name="capture",
        title="wire capture",
        reader=_FORMATS + "wire:WireReader",
        writer="",
        suffixes=(".x2cap",),
        magic=b"X2RADARC",
    ),
)
KINDS = {kind.name: kind for kind in _KINDS}


def kind_by_name(path: Path) -> Kind | None:
    """Return the format that a file's name promises, or None."""
    for kind in KINDS.values():
        if path.name.endswith(kind.suffixes):
            return kind
    return None


def kind_of(path: Path) -> Kind:
    """Return the format of what is there, by content first, then by name.

    Raises
    ------
    RecordingError
        If nothing is there, or nothing says what it is.
    """
    if path.is_dir():
        return KINDS["hdf5" if _h5_files(path) and not _xethru_files(path) else "xethru"]
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(16)
        for kind in KINDS.values():
            if kind.magic and head.startswith(kind.magic):
                return kind
    found = kind_by_name(path)
    if found is None and path.with_name(path.name + ".sigmf-meta").is_file():
        found = KINDS["sigmf"]
    if not (found or path.exists()):
        raise refuse(path, "no such recording")
    if found is None:
        known = ", ".join(kind.title for kind in KINDS.values())
        raise refuse(path, f"no recording of a known format ({known})")
    return found


def open_recording(
    path: str | Path | Sequence[str | Path],
    *,
    kind: str | None = None,
    overrides: Overrides = NO_OVERRIDES,
) -> BlockReader:
    """Return a reader for a recording of any format in `KINDS`.

    Parameters
    ----------
    path : str, Path or a sequence of them
        A file, a XeThru folder, a folder with the parts of one HDF5 recording, a list of
        such parts, or the name that was given to a recording in parts.
    kind : str, optional
        Name of the format, instead of looking.
    overrides : Overrides
        Instead of what the recording says about its axis and rate.

    Returns
    -------
    BlockReader
        Has stream, n_frames, started_utc, warning, labels, device and settings, and yields
        `frames(start_s)` or `blocks()`.

    Raises
    ------
    RecordingError
        If nothing readable is there; one line that says what.
    """
    if not isinstance(path, str | Path):
        return _open_parts([Path(p) for p in path], overrides)
    path = Path(path)
    try:
        found = KINDS[kind] if kind else kind_of(path)
        if found.name == "hdf5" and not path.is_file():
            return _open_parts(_h5_files(path) or _parts_of(path), overrides)
        return found.open(path, overrides)
    except OSError as err:
        raise refuse(path, f"cannot be read: {err.strerror or err}") from err


def _open_parts(paths: list[Path], overrides: Overrides) -> BlockReader:
    from x2radar.recording.rotating import PartsReader  # noqa: PLC0415 - h5py takes a while

    if not paths:
        msg = "no parts of a recording are named"
        raise RecordingError(msg)
    return PartsReader(paths, overrides)


def _parts_of(path: Path) -> list[Path]:
    from x2radar.recording.rotating import existing_parts  # noqa: PLC0415 - h5py takes a while

    parts = existing_parts(path)
    if not parts:
        raise refuse(path, "no such recording" if not path.is_dir() else "no .h5 file in it")
    return parts


def _h5_files(path: Path) -> list[Path]:
    return sorted(p for p in path.glob("*.h5") if not p.name.startswith("."))


def _xethru_files(path: Path) -> bool:
    return any(path.glob("xethru_*.dat"))
