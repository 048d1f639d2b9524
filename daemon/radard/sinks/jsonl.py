"""JSON Lines on stdout or into a file, one object a line, flushed as it comes."""

import json
import sys
from pathlib import Path

from radard.errors import OutputError
from radard.output import Record


class JsonLinesSink:
    """Write records as JSON Lines.

    Parameters
    ----------
    path : str or None
        File to append to; None is stdout.

    Raises
    ------
    OutputError
        If the file cannot be opened.
    """

    def __init__(self, path: str | None) -> None:
        self._path = path
        if path is None:
            self._file = sys.stdout
            return
        try:
            self._file = Path(path).open("a", encoding="utf-8")  # noqa: SIM115 - closed in close
        except OSError as err:
            msg = f"--output json:{path}: cannot write there: {err.strerror}"
            raise OutputError(msg) from err

    def write(self, record: Record) -> None:
        """As in `Sink`."""
        line = json.dumps(record, separators=(",", ":"), allow_nan=False)
        try:
            self._file.write(line + "\n")
            self._file.flush()
        except BrokenPipeError:
            raise
        except OSError as err:
            msg = f"--output json:{self._path or 'stdout'}: {err.strerror}"
            raise OutputError(msg) from err

    def close(self) -> None:
        """As in `Sink`."""
        if self._path is not None:
            self._file.close()
