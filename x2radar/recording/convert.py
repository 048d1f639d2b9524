"""Convert a recording from any format that is read to any that is written."""

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from x2radar.errors import SettingsError, X2RadarError
from x2radar.recording.blocks import NO_OVERRIDES, BlockReader, Overrides, refuse
from x2radar.recording.formats.sigmf import pair_of
from x2radar.recording.registry import KINDS, Kind, kind_by_name, open_recording

WRITABLE = tuple(name for name, kind in KINDS.items() if kind.writer)


@dataclass(frozen=True, slots=True)
class Converted:
    """What a conversion did."""

    kind: str
    n_frames: int
    duration_s: float
    notes: tuple[str, ...]


def convert(
    source: Path,
    out: Path,
    *,
    source_kind: str | None = None,
    out_kind: str | None = None,
    overrides: Overrides = NO_OVERRIDES,
) -> Converted:
    """Write the recording `source` in another format.

    Parameters
    ----------
    source : Path
        What `open_recording` opens.
    out : Path
        File or folder to make; nothing is ever overwritten, and a failed conversion leaves
        nothing behind.
    source_kind, out_kind : str, optional
        Names of formats; else by content, and by the suffix of `out`.
    overrides : Overrides
        Instead of what the source says about its axis and rate.

    Returns
    -------
    Converted
        What was done.

    Raises
    ------
    RecordingError
        If the source is unreadable, or `out` exists or cannot be made.
    SettingsError
        If the format of `out` is unknown or cannot hold these frames.
    """
    kind = _kind_to_write(out, out_kind)
    for path in pair_of(out) if kind.name == "sigmf" else (out,):
        if path.exists():
            raise refuse(path, "exists already; recordings are never overwritten")
    with open_recording(source, kind=source_kind, overrides=overrides) as reader:
        with _beside(out) as folder:
            try:
                notes = kind.write(folder / out.name, reader)
            except OSError as err:
                msg = f"{out}: cannot write: {err.strerror or err}"
                raise X2RadarError(msg) from err
            _put_in_place(folder, out)
        duration_s = _duration_s(reader)
        warnings = [reader.warning] if reader.warning else []
        return Converted(kind.name, reader.n_frames, duration_s, (*warnings, *notes))


def _kind_to_write(out: Path, out_kind: str | None) -> Kind:
    kind = KINDS[out_kind] if out_kind else kind_by_name(out)
    if kind is None:
        msg = f"{out}: its name names no format; use --to with one of {', '.join(WRITABLE)}"
        raise SettingsError(msg)
    if not kind.writer:
        msg = f"{out}: {kind.title}s are only read; written are {', '.join(WRITABLE)}"
        raise SettingsError(msg)
    return kind


@contextlib.contextmanager
def _beside(out: Path) -> Iterator[Path]:
    """Lend an empty folder on the file system of `out`, and take it away again."""
    try:
        folder = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    except OSError as err:
        raise refuse(out, f"cannot make it there: {err.strerror}") from err
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _put_in_place(folder: Path, out: Path) -> None:
    """Move what was written to its place; nothing is replaced."""
    # Data before meta: whoever sees the meta file finds its data.
    pairs = [(made, out.parent / made.name) for made in sorted(folder.iterdir())]
    for _, place in pairs:
        if place.exists():
            raise refuse(place, "exists already; recordings are never overwritten")
    moved: list[Path] = []
    try:
        for made, place in pairs:
            made.rename(place)
            moved.append(place)
    except OSError as err:
        for place in moved:
            with contextlib.suppress(OSError):
                place.unlink()
        raise refuse(out, f"cannot make it there: {err.strerror}") from err


def _duration_s(reader: BlockReader) -> float:
    end_s = 0.0
    for block in reader.blocks(samples=False):
        end_s = float(block.t_s[-1])
    return end_s + 1 / reader.stream.frame_rate_hz
