"""Labels: people's verdicts on events, one JSON object a line, for `train-export finetune`.

Lines are only added; the last one of an event holds. `wrong` says only that the verdict was wrong:
of an alarm, that it was no human.
"""

import contextlib
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

LABELS = ("human", "pet", "other", "wrong")
FORMAT, VERSION = "radard-label", 1


def label_lines(path: Path) -> Iterator[dict[str, Any] | None]:
    """Yield every line of labels, None for one that is none; raises OSError."""
    for text in path.read_text(encoding="utf-8-sig", errors="replace").splitlines():
        line: Any = None
        with contextlib.suppress(ValueError):
            line = json.loads(text)
        is_label = isinstance(line, dict) and isinstance(line.get("event"), str)
        yield line if is_label and line.get("label") in LABELS else None


def read_labels(path: Path) -> dict[str, str]:
    """Return the label of every labelled event, by its id; lines that are none are left out."""
    try:
        return {line["event"]: line["label"] for line in label_lines(path) if line}
    except OSError:
        return {}


def add_label(path: Path, line: Mapping[str, Any]) -> None:
    """Add a line with the keys of the module's example; raises OSError if it cannot."""
    full = {"format": FORMAT, "format_version": VERSION, **line}
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    size = path.stat().st_size if path.exists() else 0
    # What a power cut has left of a line must not take this one along.
    begin = b"\n" if size and path.read_bytes()[-1:] != b"\n" else b""
    try:
        with path.open("ab") as file:
            file.write(begin + json.dumps(full).encode() + b"\n")
    except OSError as err:
        err.filename = str(path)
        with contextlib.suppress(OSError):
            os.truncate(path, size)
        raise
