"""Labels: people's verdicts on events, one JSON object a line, for `train-export finetune`.

::

    {"format": "radard-label", "format_version": 1, "event": ULID,
     "label": "human|pet|other|wrong", "clip": "/path/ULID.h5", "sensor": "hall",
     "kind": "alarm", "peak": 0.93, "model": "thesis", "time": "2026-…Z"}

Lines are only added; the last one of an event holds. `wrong` says only that the verdict was
wrong: of an alarm, that it was no human.
"""

import json
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from radard.errors import OutputError

LABELS = ("human", "pet", "other", "wrong")
FORMAT, VERSION = "radard-label", 1
_MAX_BYTES = 20_000_000  # a hundred thousand labels


class LabelFile:
    """The labels of one sensor, in a file made with the first; any thread may use it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._seen: tuple[int, int] | None = None
        self._labels: dict[str, str] = {}

    def labels(self) -> dict[str, str]:
        """Return the label of every labelled event, by its id."""
        with self._lock:
            return dict(self._read())

    def add(self, line: Mapping[str, Any]) -> None:
        """Add a line with the keys of the module's example; raises OutputError if it cannot."""
        full = {"format": FORMAT, "format_version": VERSION, **line}
        with self._lock:
            try:
                self.path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
                if self.path.exists() and self.path.stat().st_size > _MAX_BYTES:
                    msg = f"{self.path}: larger than {_MAX_BYTES / 1e6:g} MB; move it away"
                    raise OutputError(msg)
                with self.path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(full) + "\n")
            except OSError as err:
                msg = f"{self.path}: cannot keep the label: {err.strerror or err}"
                raise OutputError(msg) from err

    def _read(self) -> dict[str, str]:
        try:
            stat = self.path.stat()
        except OSError:
            return {}
        seen = (stat.st_mtime_ns, stat.st_size)
        if seen != self._seen:
            self._labels = dict(_lines(self.path))
            self._seen = seen
        return self._labels


def _lines(path: Path) -> list[tuple[str, str]]:
    """Return event and label of every line that has them."""
    found = []
    for text in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            line = json.loads(text)
        except ValueError:
            continue
        if isinstance(line, dict) and isinstance(line.get("event"), str):
            label = line.get("label")
            if label in LABELS:
                found.append((line["event"], str(label)))
    return found
