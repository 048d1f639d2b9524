"""The picture of an alarm: drawn beside its clip when the alarm begins, and again at the end."""

from pathlib import Path

from radard.outputs.base import Record

_MAX_BYTES = 4_000_000  # a picture of the longest clip has a tenth of that


def picture_path(record: Record) -> Path | None:
    """Return where an alarm's picture is, or will be; None for a record without a clip."""
    clip = record.get("clip") if record.get("kind") == "alarm" else None
    return Path(clip).with_suffix(".png") if clip else None


class PictureWatch:
    """Follow the picture of the newest alarm."""

    def __init__(self) -> None:
        self._path: Path | None = None
        self._seen_ns = 0

    def follow(self, record: Record) -> None:
        """Take a record; that of an alarm with a clip names the picture from now on."""
        path = picture_path(record)
        if path is not None and path != self._path:
            self._path, self._seen_ns = path, 0

    def again(self) -> None:
        """Show it once more: who has it may have lost it."""
        self._seen_ns = 0

    def fresh(self) -> bytes | None:
        """Return the picture if it has changed since the last call."""
        if self._path is None:
            return None
        try:
            about = self._path.stat()
            if about.st_mtime_ns == self._seen_ns or about.st_size > _MAX_BYTES:
                return None
            data = self._path.read_bytes()
        except OSError:
            # Not drawn yet, or taken away to make room.
            return None
        self._seen_ns = about.st_mtime_ns
        return data
