"""Convert a recording from any format that is read to any that is written."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

from x2radar.errors import RecordingError, SettingsError, WriteError
from x2radar.recording.about import NO_OVERRIDES, Overrides
from x2radar.recording.faults import refuse, refuse_taken
from x2radar.recording.registry import FORMATS, WRITABLE, Format, format_by_name, open_recording


@dataclass(frozen=True, slots=True)
class Converted:
    """Format, length and remarks of a conversion that succeeded."""

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
    """Write the recording `source` as a new file or folder `out`, whole or not at all."""
    found = _format_to_write(out, out_kind)
    for path in found.files(out):
        refuse_taken(path)
    with open_recording(source, kind=source_kind, overrides=overrides) as reader:
        with _beside(out) as name:
            folder = Path(name)
            try:
                notes = found.write(folder / out.name, reader)
            except OSError as err:
                raise WriteError.of(out, err) from err
            except WriteError as err:
                # Its name is that of the file beside it.
                raise WriteError.of(out, err.why) from err
            _put_in_place(folder, out)
        *_, last = reader.blocks(samples=False)
        duration_s = float(last.t_s[-1]) + 1 / reader.stream.frame_rate_hz
        warnings = [reader.warning] if reader.warning else []
        return Converted(found.name, reader.n_frames, duration_s, (*warnings, *notes))


def _format_to_write(out: Path, out_kind: str | None) -> Format:
    found = FORMATS[out_kind] if out_kind else format_by_name(out)
    if found is None:
        msg = f"{out}: its name names no format; use --to with one of {', '.join(WRITABLE)}"
        raise SettingsError(msg)
    if not found.writer:
        msg = f"{out}: {found.title}s are only read; written are {', '.join(WRITABLE)}"
        raise SettingsError(msg)
    return found


def _beside(out: Path) -> tempfile.TemporaryDirectory[str]:
    """Return an empty folder on the file system of `out`, which goes away again."""
    try:
        return tempfile.TemporaryDirectory(
            prefix=f".{out.name}.", dir=out.parent, ignore_cleanup_errors=True
        )
    except OSError as err:
        raise refuse(out, f"cannot make it there: {err.strerror}") from err


def _put_in_place(folder: Path, out: Path) -> None:
    """Move what was written to its place; nothing is replaced."""
    moved: list[Path] = []
    try:
        # Data before meta: a program that sees the meta file finds its data.
        for made in sorted(folder.iterdir()):
            refuse_taken(place := out.parent / made.name)
            made.rename(place)
            moved.append(place)
    except (OSError, RecordingError) as err:
        for place in moved:
            place.unlink(missing_ok=True)
        if isinstance(err, RecordingError):
            raise
        raise refuse(out, f"cannot make it there: {err.strerror}") from err
