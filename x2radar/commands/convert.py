"""`x2radar convert`: a recording of any known format into another."""

import argparse
import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from x2radar.commands import Commands, add_command
from x2radar.errors import RecordingError, SettingsError, WriteError
from x2radar.recording.about import NO_OVERRIDES, Overrides, option_of
from x2radar.recording.faults import refuse, refuse_taken
from x2radar.recording.registry import FORMATS, READABLE, WRITABLE, format_by_name, open_recording

_AXIS = {
    "frame_rate_hz": "frames per second",
    "bin_length_m": "range of one bin, in metres",
    "range_offset_m": "range of bin 0, in metres",
    "carrier_hz": "centre frequency",
    "bandwidth_hz": "bandwidth at -10 dB",
    "sample_rate_hz": "rate of the RF sampler",
}


def register(commands: Commands) -> None:
    parser = add_command(
        commands,
        "convert",
        "write a recording in another format",
        "examples:\n"
        "  x2radar convert dog.h5 dog.npz\n"
        "  x2radar convert walk.npz walk.h5 --frame-rate 200 --bin-length 0.0514\n",
    )
    parser.add_argument("source", type=Path, metavar="IN", help="file or folder to read")
    parser.add_argument("out", type=Path, metavar="OUT", help="file or folder to make")
    parser.add_argument("--from", dest="source_kind", choices=READABLE, help="format of IN")
    parser.add_argument("--to", dest="out_kind", choices=WRITABLE, help="format of OUT")
    for name, text in _AXIS.items():
        unit = name.rpartition("_")[2].upper()
        parser.add_argument(option_of(name), dest=name, type=float, metavar=unit, help=text)
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    values = {name: getattr(args, name) for name in _AXIS}
    for name, value in values.items():
        is_signed = name == "range_offset_m"
        if value is not None and not (math.isfinite(value) and (value > 0 or is_signed)):
            what = "a number" if is_signed else "above 0"
            raise SettingsError(f"{option_of(name)} {value:g}: must be {what}")
    done = convert(
        args.source,
        args.out,
        source_kind=args.source_kind,
        out_kind=args.out_kind,
        overrides=Overrides(**values),
    )
    for note in done.notes:
        print(f"x2radar: {note}", file=sys.stderr)
    about = f"{done.n_frames} frames, {done.duration_s:.1f} s, {FORMATS[done.kind].title}"
    print(f"{args.out}: {about}", file=sys.stderr)
    return 0


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
    found = FORMATS[out_kind] if out_kind else format_by_name(out)
    if found is None:
        msg = f"{out}: its name names no format; use --to with one of {', '.join(WRITABLE)}"
        raise SettingsError(msg)
    if not found.writer:
        msg = f"{out}: {found.title}s are only read; written are {', '.join(WRITABLE)}"
        raise SettingsError(msg)
    for path in found.files(out):
        refuse_taken(path)
    with open_recording(source, kind=source_kind, overrides=overrides) as reader:
        try:
            # On the file system of `out`; it goes away again.
            with tempfile.TemporaryDirectory(
                prefix=f".{out.name}.", dir=out.parent, ignore_cleanup_errors=True
            ) as folder:
                try:
                    notes = found.write(Path(folder) / out.name, reader)
                except (OSError, WriteError) as err:
                    # Its name is that of the file beside it.
                    raise WriteError.of(out, getattr(err, "why", err)) from err
                _put_in_place(Path(folder), out)
        except OSError as err:
            raise refuse(out, f"cannot make it there: {err.strerror}") from err
        t_s = reader.lists()[1]
        duration_s = float(t_s[-1] - t_s[0]) + 1 / reader.stream.frame_rate_hz
        warnings = [reader.warning] if reader.warning else []
        return Converted(found.name, reader.n_frames, duration_s, (*warnings, *notes))


def _put_in_place(folder: Path, out: Path) -> None:
    """Move what was written to its place; nothing is replaced."""
    moved: list[Path] = []
    try:
        # Data before meta: a program that sees the meta file finds its data.
        for made in sorted(folder.iterdir()):
            refuse_taken(place := out.parent / made.name)
            made.rename(place)
            moved.append(place)
    except (OSError, RecordingError):
        for place in moved:
            place.unlink(missing_ok=True)
        raise
