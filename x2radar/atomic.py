"""Atomic writes: readers, and a power failure, find all of the old file or all of the new one."""

import contextlib
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from x2radar.errors import WriteError


def write_atomically(
    path: Path, content: str | bytes, *, sync: bool = True, mode: int = 0o644
) -> None:
    """Write a file whole or not at all, `sync` over a power failure; text as UTF-8.

    A missing folder is made for its owner alone. Raises OSError; the old file is then as it was.
    """
    with whole_file(path) as made:
        if not made.parent.exists():
            made.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with made.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            if made != path:
                os.fchmod(file.fileno(), mode)
                if sync:
                    file.flush()
                    os.fsync(file.fileno())
    if sync:
        sync_path(Path(os.path.realpath(path)).parent)


def sync_path(path: Path) -> None:
    """Wait until a closed file, or a folder's list of names, is on the disk; raises OSError."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Lend the name of a file that is put in the place of `path` at the end, or taken away.

    A link stays one, and leads to the new file. What is no file, as /dev/null, is lent itself.
    """
    if path.exists() and not path.is_file():
        yield path
        return
    place = Path(os.path.realpath(path))
    made = place.with_name(f".{place.name}.{os.getpid()}.new")
    try:
        yield made
        made.replace(place)
    except OSError as err:
        err.filename = str(path)
        raise
    finally:
        with contextlib.suppress(OSError):
            made.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write the file that somebody asked for, whole or not at all; WriteError if it cannot be."""
    try:
        write_atomically(path, content)
    except OSError as err:
        raise WriteError.of(path, err) from err


def write_picture(path: Path, figure: Any) -> None:
    """Write a figure of matplotlib's whole or not at all; WriteError if it cannot be."""
    if not path.parent.is_dir():
        raise WriteError.of(path, "there is no such folder")
    picture = io.BytesIO()
    figure.savefig(picture, format=path.suffix.removeprefix("."), dpi=110)
    write_whole(path, picture.getvalue())
