"""Room for clips: which of them go, and in which order they came.

The times of the files say in which order clips were made, and nothing else: one that is made is
dated behind all others (`date_last`), so a clock that was ahead, or is set, takes none away.
"""

import os
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

from radard.errors import OutputError

_STEP_NS = 2_000_000_000  # FAT keeps times to 2 s
_NAME = re.compile(r"[0-9A-HJKMNP-TV-Z]{26}\.(h5|png)")


def prepare_folder(folder: Path, *, free_bytes: float) -> None:
    """Make a folder for clips, and room for one more; OutputError without, or OSError."""
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    # One that has another name, too, as in a backup, would make no room.
    clips = [c for c in _oldest_first(folder) if all(p.stat().st_nlink == 1 for p in c)]
    if free_bytes - shutil.disk_usage(folder).free > sum(map(_size_of, clips)):
        raise OutputError(f"{folder}: less than {free_bytes / 1e6:g} MB are free")
    for clip in clips:
        if shutil.disk_usage(folder).free >= free_bytes:
            break
        _remove(clip)
    trial = folder / ".trial.new"
    trial.touch()
    trial.unlink()


def limit_size(folder: Path, *, keep_bytes: float) -> None:
    """Take the oldest clips away until they are no larger than `keep_bytes`; the newest stays."""
    clips = _oldest_first(folder)
    total = sum(map(_size_of, clips))
    for clip in clips[:-1]:
        if total <= keep_bytes:
            break
        total -= _size_of(clip)
        _remove(clip)


def date_last(path: Path) -> None:
    """Date a file of a clip behind those of all others, where the clock has not done so."""
    newest = max((_time_ns(c) for c in _oldest_first(path.parent) if path not in c), default=0)
    if path.stat().st_mtime_ns <= newest:
        later_ns = newest + _STEP_NS
        os.utime(path, ns=(later_ns, later_ns))


def _oldest_first(folder: Path) -> list[tuple[Path, ...]]:
    found: dict[str, tuple[Path, ...]] = {}
    for path in folder.iterdir():
        if _NAME.fullmatch(path.name):
            found[path.stem] = (*found.get(path.stem, ()), path)
    return sorted(found.values(), key=lambda clip: (_time_ns(clip), clip[0].stem))


def _time_ns(clip: Sequence[Path]) -> int:
    return max(path.stat().st_mtime_ns for path in clip)


def _size_of(clip: Sequence[Path]) -> int:
    return sum(path.stat().st_size for path in clip)


def _remove(clip: Sequence[Path]) -> None:
    for path in clip:
        path.unlink(missing_ok=True)
